"""What a scene in XML can do: nothing but describe shapes. No code, no file of the user's, no endless work."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from scanner_sim.foundation.errors import InputError, printable
from scanner_sim.scene.files.scene_rules import renderers_scene

PLY = (Path(__file__).parents[1] / "triangle.ply").read_text(encoding="utf-8")
XML = """\
<scene version="3.0.0">
<bsdf type="twosided" id="paint"><bsdf type="diffuse"><spectrum name="reflectance" value="0.3"/></bsdf></bsdf>
<shape type="sphere"><float name="radius" value="0.5"/><ref id="paint"/></shape>
<shape type="ply"><string name="filename" value="part.ply"/></shape>
</scene>
"""
BLEND = '<bsdf type="blendbsdf" id="b"><ref id="paint"/><ref id="paint"/></bsdf>'
SCENARIO = """\
schema: 1
scanner: {preset: nrc_2000}
scene:
  file: scene.xml
  objects:
    - {name: tape, shape: disc, diameter: 1 m, position: [0 m, 0 m, 4 m], material: retro_sheet}
lighting: {sun: {direction: [-0.4, -0.5, -0.77]}, earth: {direction: [0, 1, 0]}}
scan: {type: raster, rows: 4, columns: 4, horizontal: [-1 deg, 1 deg], vertical: [-1 deg, 1 deg]}
camera:
  interior: {columns: 64, rows: 48, pixel_pitch: 100 um}
  sampling: {samples: 4, edge_samples: 4}
output: {pictures: true}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "part.ply").write_text(PLY)
    (tmp_path / "scene.xml").write_text(XML)
    return tmp_path


def refusal(folder: Path, old: str, new: str) -> str:
    """Return the one message on a scene with a change."""
    assert old in XML
    (folder / "scene.xml").write_text(XML.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        renderers_scene(folder / "scene.xml")
    message = str(caught.value)
    assert message.isprintable()
    return message


def mapped(command: str, folder: Path) -> str:
    """Return what a fresh process has in its memory after some statements, in a folder with plugins."""
    code = f"{command}\nfrom pathlib import Path\nprint(Path('/proc/self/maps').read_text())"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def hostile(folder: Path) -> Path:
    """A folder whose plugins have the names of all that the renderer has, and of ours."""
    import mitsuba as mi

    home = Path(str(mi.__file__)).parent / "plugins"
    (folder / "plugins").mkdir()
    library = next(home.glob("diffuse.*"))
    names = {path.name for path in home.iterdir()}
    for name in (
        *names,
        *(f"{own}{library.suffix}" for own in ("retroreflector", "orbit_sky", "evil", "scene")),
    ):
        shutil.copy(library, folder / "plugins" / name)
    shutil.copy(library, folder.parent / f"evil2{library.suffix}")
    (folder / "scenario.yaml").write_text(SCENARIO)
    return folder


@pytest.mark.slow
def test_no_library_of_a_shared_folder_is_loaded(hostile: Path) -> None:
    """A run with pictures, the Sun, a retro-reflector and an XML scene maps no library from its own folder."""
    command = "from scanner_sim.cli import main\nimport sys\n"
    command += "sys.argv = ['scanner-sim', 'run', 'scenario.yaml', '-o', 'out']\n"
    command += "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code, end.code"
    assert str(hostile) not in mapped(command, hostile)
    assert (hostile / "out" / "camera.png").exists()


def test_the_check_on_libraries_sees_one(hostile: Path) -> None:
    """Without the guard the renderer takes the library of the working folder, and the test above sees it."""
    command = (
        "import mitsuba as mi\nmi.set_variant('scalar_rgb')\nmi.PluginManager.instance().plugin_type('evil')"
    )
    assert f"{hostile}/plugins/evil" in mapped(command, hostile)


@pytest.mark.parametrize(
    "kind", ["evil", "../evil2", "plugins/evil", "/tmp/evil", "instance", "blender", "sphre", ""]
)
def test_only_known_types_are_built(kind: str, hostile: Path) -> None:
    message = refusal(hostile, 'type="sphere"', f'type="{kind}"')
    assert "line 3" in message
    refusal(hostile, 'type="diffuse"', f'type="{kind}"')


def test_lights_and_cameras_are_not_built(folder: Path) -> None:
    extra = '<emitter type="evil"/><integrator type="../evil"/><sensor type="x"><film type="y"/></sensor>'
    (folder / "scene.xml").write_text(XML.replace("<shape", extra + "<shape", 1))
    assert "evil" not in renderers_scene(folder / "scene.xml")


def test_includes_parameters_and_aliases_are_resolved(folder: Path) -> None:
    (folder / "more.xml").write_text(
        '<scene version="3.0.0"><shape type="$kind"><ref id="colour"/></shape></scene>'
    )
    more = '<default name="kind" value="cube"/><alias id="paint" as="colour"/><include filename="more.xml"/></scene>'
    (folder / "scene.xml").write_text(XML.replace("</scene>", more))
    assert '<shape type="cube"><ref id="paint"></ref></shape>' in renderers_scene(folder / "scene.xml")


@pytest.mark.parametrize(
    "name",
    [
        "/dev/zero.ply",
        "/etc/passwd",
        "../part.ply",
        "a/../../x.ply",
        "out.ply",
        "a&#10;b.ply",
        "part.txt",
    ],
)
@pytest.mark.parametrize("way", ["mesh", "include"])
def test_a_scene_names_only_files_beside_it(name: str, way: str, folder: Path) -> None:
    (folder.parent / "part.ply").write_text("a secret line\n" * 3)
    (folder / "out.ply").symlink_to(folder.parent / "part.ply")
    if way == "mesh":
        message = refusal(folder, 'value="part.ply"', f'value="{name}"')
    else:
        message = refusal(folder, "<shape", f'<include filename="{name}"/><shape')
    assert "secret" not in message


@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "missing"])
def test_a_file_that_is_not_ordinary_is_not_opened(kind: str, folder: Path) -> None:
    """A pipe without a writer and /dev/zero would keep a reader for ever."""
    path = folder / "strange.xml"
    match kind:
        case "pipe":
            os.mkfifo(path)
        case "device":
            path = Path("/dev/zero")
        case "folder":
            path.mkdir()
    with pytest.raises(InputError, match=r"ordinary|opened"):
        renderers_scene(path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<scene", '<!DOCTYPE s [<!ENTITY a "b">]><scene', "document type"),
        ("<shape", "<x/><shape", "<x> is not possible"),
        ("<shape", '<path value="/tmp"/><shape', "<path> is not possible"),
        ("<shape", '<include filename="scene.xml"/><shape', "include one another"),
        ("<shape", "text<shape", "text between"),
        ('value="0.5"', 'value="0"', "'radius' is 0; it must be more than 0"),
        ('value="0.5"', 'value="nan"', "not finite"),
        ('value="0.5"', 'value="-1"', "more than 0"),
        ('value="0.5"', 'value="half"', "is not 1 number"),
        ('value="0.5"', 'value="$r"', "has no value"),
        ('value="0.3"', 'value="nan"', "not finite"),
        ('value="0.3"', 'value="1.5"', "from 0 to 1"),
        ('value="0.3"', 'value="400:0.1 700:0.2"', "is not 1 number"),
        ('<spectrum name="reflectance" value="0.3"/>', '<rgb name="reflectance" value="1 0 0"/>', "visible light"),
        ('<spectrum name="reflectance" value="0.3"/>', '<string name="material" value="Au"/>', "numbers at 1.5"),
        ('<spectrum name="reflectance" value="0.3"/>', '<spectrum name="reflectance" filename="x"/>', "attribute"),
        ('id="paint"', 'id="pai&#10;nt"', "cannot be an id"),
        ('id="paint"', 'id="&lt;b&gt;"', "cannot be an id"),
        ('id="paint"', 'id="point"', "Did you mean 'point'?"),
        ('<bsdf type="diffuse">', '<ref id="paint"/><bsdf type="diffuse">', "holds itself"),
        ("<spectrum", '<texture type="uniform"><ref id="paint"/></texture><spectrum', "holds itself"),
        ("<scene version", "<scene q='1' version", "has no attribute 'q'"),
        ('<bsdf type="diffuse">', '<bsdf type="blendbsdf"/><bsdf type="diffuse">', "made of 2 others, and 0 stand"),
        ("<shape", '<bsdf type="mask" id="m"/><shape', "made of 1 others, and 0 stand"),
        ("<shape", BLEND + "<shape", "lacks its weight"),
        ("<float", '<transform name="to_world"><scale value="inf"/></transform><float', "not finite"),
    ],
)  # fmt: skip
def test_a_fault_of_a_scene_is_said_with_its_line(old: str, new: str, words: str, folder: Path) -> None:
    message = refusal(folder, old, new)
    assert words in message
    assert "scene.xml" in message


def test_parameters_and_materials_do_not_grow_without_end(folder: Path) -> None:
    defaults = '<default name="a0" value="xxxxxxxxxx"/>'
    defaults += "".join(f'<default name="a{n + 1}" value="$a{n} $a{n}"/>' for n in range(60))
    assert "characters" in refusal(folder, "<shape", defaults + "<shape")
    half = '<float name="weight" value="0.5"/>'
    bsdfs = "".join(
        f'<bsdf type="blendbsdf" id="b{n}">{half}<ref id="{below}"/><ref id="{below}"/></bsdf>'
        for n, below in enumerate(["paint", *(f"b{n}" for n in range(40))])
    )
    assert "parts" in refusal(folder, "<shape", bsdfs + "<shape")
    deep = '<bsdf type="twosided">' * 3000
    assert "within one another" in refusal(folder, "<shape", deep + "<shape")


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("value", ["1e9", "-1"])
def test_what_a_plugin_of_ours_refuses_is_said_in_a_sentence(value: str, folder: Path) -> None:
    """Not with the lines of the program that the renderer adds to it."""
    from scanner_sim.foundation.errors import ScenarioError
    from scanner_sim.scene.files.loader import load_scene
    from scanner_sim.scene.objects import Scene

    tape = f'<bsdf type="retroreflector"><float name="entrance_half_angle" value="{value}"/></bsdf>'
    (folder / "scene.xml").write_text(XML.replace('<ref id="paint"/>', tape))
    with pytest.raises(ScenarioError, match="retroreflector: entrance_half_angle is") as found:
        load_scene(Scene(file=folder / "scene.xml"))
    assert "Traceback" not in str(found.value)
    assert ".py" not in str(found.value)


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("stem", ["a\nb", "\x1b[31mred", "back\u202e", "half \udcff"], ids=ascii)
def test_a_scene_may_have_any_name(stem: str, folder: Path) -> None:
    """An object of the XML file is called after it; images and pages hold such names as text."""
    from scanner_sim.scene.files.loader import load_scene
    from scanner_sim.scene.objects import Scene

    path = (folder / "scene.xml").rename(folder / f"{stem}.xml")
    (name,) = load_scene(Scene(file=path)).objects
    assert name.isprintable()
    assert name == printable(stem)


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("step", ['<scale value="0"/>', '<scale x="0" y="1" z="1"/>', '<translate x="1e8"/>'])
def test_a_transform_keeps_shapes_whole_and_near(step: str, folder: Path) -> None:
    from scanner_sim.foundation.errors import ScenarioError
    from scanner_sim.scene.files.loader import load_scene
    from scanner_sim.scene.objects import Scene

    moved = XML.replace("<float", f'<transform name="to_world">{step}</transform><float')
    (folder / "scene.xml").write_text(moved)
    with pytest.raises(ScenarioError, match=r"flattens|reaches beyond"):
        load_scene(Scene(file=folder / "scene.xml"))
