"""A scene in XML: how much there may be of it, which numbers are possible, and what the renderer is handed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from scanner_sim.foundation.errors import InputError
from scanner_sim.scene.files import scene_rules, scene_xml
from scanner_sim.scene.files.scene_rules import files_of_scene, renderers_scene

HEAD, TAIL = '<scene version="3.0.0">', "</scene>"
BALL = '<shape type="sphere"><float name="radius" value="0.5"/></shape>'
PAINT = '<bsdf type="diffuse" id="{}"><spectrum name="reflectance" value="0.3"/></bsdf>'


def handed(folder: Path, inside: str, name: str = "scene.xml") -> str:
    """Return what the renderer is handed of a scene with these elements."""
    (folder / name).write_text(f"{HEAD}{inside}{TAIL}")
    return renderers_scene(folder / name)


def is_taken(folder: Path, inside: str) -> bool:
    """Return whether a scene is taken; if not, one sentence says why and in which line."""
    try:
        handed(folder, inside)
    except InputError as error:
        said = str(error)
    else:
        return True
    assert "line 1 of" in said
    return False


@pytest.mark.parametrize("most", [1, 19])
def test_so_many_files_may_be_included(most: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_xml, "MOST_FILES", most)
    (tmp_path / "part.xml").write_text(f"{HEAD}{BALL}{TAIL}")
    include = '<include filename="part.xml"/>'
    assert handed(tmp_path, most * include).count("sphere") == most
    assert not is_taken(tmp_path, (most + 1) * include)


def test_fifteen_files_may_stand_within_one_another(tmp_path: Path) -> None:
    for n in range(16):
        inside = BALL if n == 0 else f'<include filename="{n - 1}.xml"/>'
        (tmp_path / f"{n}.xml").write_text(f"{HEAD}{inside}{TAIL}")
    assert handed(tmp_path, '<include filename="14.xml"/>').count("sphere") == 1
    assert not is_taken(tmp_path, '<include filename="15.xml"/>')


def test_of_two_defaults_of_a_parameter_the_first_one_counts(tmp_path: Path) -> None:
    """Claim: what a scene says before it includes a file holds in that file and behind it, whatever the file says; what
    only the file says holds behind it, whatever the scene says then."""
    ball = BALL.replace("0.5", "$size")
    other = '<default name="size" value="0.7"/><default name="more" value="0.9"/>'
    (tmp_path / "part.xml").write_text(f"{HEAD}{other}{ball}{TAIL}")
    behind = f'{ball}<default name="more" value="0.3"/>{BALL.replace("0.5", "$more")}'
    for first, sizes in (("0.5", ["0.5", "0.5", "0.9"]), ("", ["0.7", "0.7", "0.9"])):
        own = f'<default name="size" value="{first}"/>' if first else ""
        found = handed(tmp_path, f'{own}<include filename="part.xml"/>{behind}')
        assert re.findall(r'name="radius" value="([^"]*)"', found) == sizes


def test_so_many_elements_and_characters_may_there_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: a limit is the largest number that is taken, for elements, for those within one another, for a value."""
    text = PAINT.format("grey") + 12 * BALL
    count, deep = len(re.findall(r"<\w", HEAD + text)), 3
    long = '<default name="x" value="abcdefg"/>' + PAINT.format("$x$x$x.")
    for name, least, inside in (
        ("MOST_ELEMENTS", count, text),
        ("DEEPEST", deep, text),
        ("LONGEST_VALUE", 22, long),
    ):
        with monkeypatch.context() as limited:
            limited.setattr(scene_xml, name, least)
            assert is_taken(tmp_path, inside), name
            limited.setattr(scene_xml, name, least - 1)
            assert not is_taken(tmp_path, inside), name


@pytest.mark.parametrize(
    ("more", "parts"),
    [
        ("", 31),
        ('<shape type="cube" id="s"><ref id="e"/></shape>', 31),
        ('<shape type="cube"><bsdf type="twosided"><ref id="e"/><ref id="a"/></bsdf></shape>', 33),
        ('<shape type="cube"><bsdf type="mask"><ref id="e"/><texture type="checkerboard" name="opacity">'
         '<texture type="uniform" name="color0"/><texture type="uniform" name="color1"/></texture></bsdf></shape>', 35),
    ],
)  # fmt: skip
def test_a_material_may_have_so_many_parts(
    more: str, parts: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Shared ones count each time: a blend of two blends of two blends of two blends of one paint has 31 parts. A shape
    is none, a texture is one; and what stands within a shape, without a name, is held to it as well."""
    weight = '<float name="weight" value="0.5"/>'
    inside = PAINT.format("a")
    for name, below in (("b", "a"), ("c", "b"), ("d", "c"), ("e", "d")):
        inside += f'<bsdf type="blendbsdf" id="{name}">{weight}<ref id="{below}"/><ref id="{below}"/></bsdf>'
    monkeypatch.setattr(scene_rules, "MOST_PARTS", parts)
    assert is_taken(tmp_path, inside + more)
    monkeypatch.setattr(scene_rules, "MOST_PARTS", parts - 1)
    assert not is_taken(tmp_path, inside + more)


@pytest.mark.parametrize(
    ("names", "taken", "refused"),
    [
        (("reflectance", "specular_transmittance", "weight", "opacity", "sheen_tint", "retro_share", "clearcoat"),
         ("0", "0.37", "1"), ("-1e-6", "1.000001")),
        (("radius", "eta", "int_ior", "alpha_v", "half_width"), ("1e-6", "2.5", "1e9"), ("0", "-0.1")),
        (("k",), ("0", "7.3"), ("-1e-6",)),
        (("to_uv", "entrance_half_angle", "spread"), ("-1e9", "-2.5", "0", "3", "1e9"), ("1.1e9", "-1.1e9", "1_0")),
    ],
)  # fmt: skip
@pytest.mark.parametrize("tag", ["float", "spectrum"])
def test_numbers_have_the_range_of_their_name(
    names: tuple[str, ...], taken: tuple[str, ...], refused: tuple[str, ...], tag: str, tmp_path: Path
) -> None:
    """A share lies from 0 to 1, a length or an index above 0, an absorption from 0 on; others are any number."""
    for name in names:
        text = f'<bsdf type="plastic"><{tag} name="{name}" value="{{}}"/></bsdf>'
        for value in (*taken, *refused):
            assert is_taken(tmp_path, text.format(value)) == (value in taken), (name, value)


@pytest.mark.parametrize(("value", "taken"), [("3", True), ("3.0", True), ("3.5", False)])
def test_a_whole_number_is_whole(value: str, taken: bool, tmp_path: Path) -> None:
    text = f'<bsdf type="plastic"><integer name="levels" value="{value}"/></bsdf>'
    assert is_taken(tmp_path, text) == taken


@pytest.mark.parametrize(
    ("step", "counts"),
    [
        ('<matrix value="{}"/>', (9, 16)),
        ('<translate value="{}"/>', (1, 3)),
        ('<scale value="{}"/>', (1, 3)),
        ('<scale x="{}"/>', (1,)),
        ('<lookat origin="{}" target="0 0 1" up="0 1 0"/>', (3,)),
        ('<lookat origin="0 0 1" target="{}" up="0 1 0"/>', (3,)),
        ('<lookat origin="0 0 1" target="0 0 2" up="{}"/>', (3,)),
        ('<rotate y="1" angle="{}"/>', (1,)),
        ('<rotate value="{}" angle="20"/>', (1, 3)),
    ],
)
def test_a_step_has_as_many_numbers_as_it_takes(step: str, counts: tuple[int, ...], tmp_path: Path) -> None:
    found = tuple(
        count
        for count in range(1, 18)
        if is_taken(
            tmp_path,
            BALL.replace(
                "<float",
                f'<transform name="to_world">{step.format(" ".join(["1"] * count))}</transform><float',
            ),
        )
    )
    assert found == counts
    wanted = " or ".join(map(str, counts)) + (" number." if counts == (1,) else " numbers.")
    with pytest.raises(InputError, match=re.escape(f"'1 1' is not {wanted}")):
        handed(
            tmp_path,
            BALL.replace("<float", f'<transform name="to_world">{step.format("1 1")}</transform><float'),
        )


@pytest.mark.parametrize(("kind", "counts"), [("mask", (1,)), ("twosided", (1, 2)), ("blendbsdf", (2,))])
@pytest.mark.parametrize("shared", [False, True])
def test_a_material_is_made_of_as_many_as_it_takes(
    kind: str, counts: tuple[int, ...], shared: bool, tmp_path: Path
) -> None:
    inner = '<ref id="grey"/>' if shared else '<bsdf type="diffuse"/>'
    weight = '<float name="weight" value="0.5"/>'
    made = f'<bsdf type="{kind}" id="m">{weight}{{}}</bsdf>'
    found = tuple(n for n in range(4) if is_taken(tmp_path, PAINT.format("grey") + made.format(n * inner)))
    assert found == counts


def test_the_renderer_is_handed_shapes_with_what_they_refer_to(tmp_path: Path) -> None:
    """Aliases by the ids they stand for, meshes by whole paths, values whole; no lights, nor what refers to them. The
    scene's files are its own and all of its meshes, whatever stands before them."""
    for name in ("a.ply", "b.obj"):
        (tmp_path / name).write_text("")
    given = (
        '<sensor type="perspective"/><emitter type="area" id="lamp"/><alias id="lamp" as="sun"/>'
        '<alias id="grey" as="old"/><alias id="old" as="other"/><shape type="ply">'
        '<string name="filename" value="a.ply"/><ref id="other"/><ref id="lamp"/><ref id="sun"/></shape>'
        '<shape type="obj"><emitter type="area"/><string name="filename" value="b.obj"/>'
        '<boolean name="face_normals" value="true"/></shape>'
        '<shape type="cube"><emitter type="area"/><string name="kind" value="a &amp; b"/></shape>'
    )
    wanted = (
        '<shape type="ply"><string name="filename" value="{}/a.ply"></string><ref id="grey"></ref></shape>\n'
        '<shape type="obj"><string name="filename" value="{}/b.obj"></string>'
        '<boolean name="face_normals" value="true"></boolean></shape>\n'
        '<shape type="cube"><string name="kind" value="a &amp; b"></string></shape>\n'
    ).replace("{}", str(tmp_path.resolve()))
    found = handed(tmp_path, PAINT.format("grey") + given)
    assert found.partition("</bsdf>\n")[2] == f"{wanted}{TAIL}\n"
    wanted_files = {tmp_path.resolve() / name for name in ("scene.xml", "a.ply", "b.obj")}
    assert {path.resolve() for path in files_of_scene(tmp_path / "scene.xml")} == wanted_files


@pytest.mark.parametrize(
    "text",
    [
        '<shape type="ply"/>',
        '<shape type="sphere"><string name="filename" value="a.ply"/></shape>',
        '<shape type="ply"><string name="filename" value="b.obj"/></shape>',
        '<shape type="sphere"><ref id="s"/></shape><shape type="cube" id="s"/>',
        '<shape type="cube" id="s"/><alias id="s" as="t"/><shape type="sphere"><ref id="t"/></shape>',
        '<shape type="sphere"><bsdf type="null"><ref id="nobody"/></bsdf></shape>',
        '<alias id="nobody" as="a"/>',
        '<bsdf type="null" id="a"/><bsdf type="null" id="a"/>',
        '<bsdf type="null" name="2"/>',
        '<bsdf type="null"><boolean name="x" value="yes"/></bsdf>',
        '<bsdf type="null"><point name="x" value="1 2 3" x="1"/></bsdf>',
        '<bsdf type="null"><point name="x"/></bsdf>',
        '<bsdf type="null"><float name="alpha" value="1"><float name="k" value="1"/></float></bsdf>',
        '<bsdf type="null"><string name="material" value="Al"/></bsdf>',
    ],
)
def test_what_cannot_be_is_refused_in_its_line(text: str, tmp_path: Path) -> None:
    for name in ("a.ply", "b.obj"):
        (tmp_path / name).write_text("")
    assert not is_taken(tmp_path, text)


@pytest.mark.parametrize(
    ("kind", "name", "taken"),
    [
        ("ply", "BODY.PLY", True), ("obj", "Part.Obj", True), ("ply", "a.b.Ply", True),
        ("ply", "PART.OBJ", False), ("obj", "BODY.PLY", False), ("ply", "bodyply", False),
    ],
)  # fmt: skip
def test_a_mesh_is_of_its_shapes_kind_however_its_ending_is_written(
    kind: str, name: str, taken: bool, tmp_path: Path
) -> None:
    """Claim: capitals of a name are no matter, as in files from Windows; the kind that it tells is the shape's."""
    (tmp_path / name).write_text("")
    assert (
        is_taken(tmp_path, f'<shape type="{kind}"><string name="filename" value="{name}"/></shape>') is taken
    )
    if taken:
        assert f'value="{tmp_path.resolve() / name}"' in renderers_scene(tmp_path / "scene.xml")


def test_text_between_elements_is_told_by_the_line_of_what_holds_it(tmp_path: Path) -> None:
    """Claim: a value that was written between two elements is no value, and the element in which it stands is named."""
    path = tmp_path / "scene.xml"
    path.write_text(f'{HEAD}\n<shape type="sphere">\n<float name="radius" value="0.5"/>\n0.7\n</shape>{TAIL}')
    with pytest.raises(InputError, match=r"line 2 of .* text between the elements"):
        renderers_scene(path)
    path.write_text(f"{HEAD}\n{BALL}\nwords{TAIL}")
    with pytest.raises(InputError, match=r"line 1 of .* text between the elements"):
        renderers_scene(path)


def test_files_that_hold_one_another_are_said_to_and_how_to_mend_it(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(f'{HEAD}<include filename="scene.xml"/>{BALL}{TAIL}')
    with pytest.raises(InputError) as told:
        renderers_scene(tmp_path / "scene.xml")
    assert told.value.message.endswith("files include one another too often.")
    assert told.value.remedy == "Look for a file that includes itself."


@pytest.mark.parametrize(
    ("step", "possible"),
    [
        ('<translate x="1" z="-2.5"/>', True), ('<translate value="1 2 3"/>', True), ('<translate/>', False),
        ('<translate value="1 2"/>', False), ('<translate value="1" x="2"/>', False), ('<scale value="2"/>', True),
        ('<rotate y="1" angle="30"/>', True), ('<rotate y="1"/>', False), ('<rotate angle="30"/>', False),
        ('<matrix value="1 0 0 0 1 0 0 0 1"/>', True), ('<matrix value="1 0 0 0"/>', False),
        ('<lookat origin="0 0 0" target="0,0,5" up="0 1 0"/>', True), ('<lookat origin="0 0 0" up="0 1 0"/>', False),
        ('<shear x="1"/>', False), ('<translate x="1e9"/>', True), ('<translate x="1.1e9"/>', False),
    ],
)  # fmt: skip
def test_a_step_of_a_transform_has_the_numbers_that_it_takes(
    step: str, possible: bool, tmp_path: Path
) -> None:
    """Claim: one number or three for a way or a scale, an angle beside an axis, nine or sixteen for a matrix, three
    places for a look; other steps are none, and numbers are of sensible size."""
    inside = f'<transform name="to_world">{step}</transform>'
    assert is_taken(tmp_path, BALL.replace("</shape>", f"{inside}</shape>")) is possible


@pytest.mark.parametrize(
    ("version", "possible"), [("3.0.0", True), ("3.5.12", True), ("3", False), ("3.0.x", False)]
)
def test_a_scene_tells_its_version(version: str, possible: bool, tmp_path: Path) -> None:
    """Claim: three numbers between points; else the line and a version to write are told."""
    (tmp_path / "scene.xml").write_text(f'<scene version="{version}">{BALL}</scene>')
    if possible:
        assert f'<scene version="{version}">' in renderers_scene(tmp_path / "scene.xml")
        return
    with pytest.raises(InputError, match="no version") as told:
        renderers_scene(tmp_path / "scene.xml")
    assert 'version="3.0.0"' in told.value.remedy
