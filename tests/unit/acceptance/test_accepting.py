"""From clouds to results, what cannot be tested and why, and what uneven light adds to a plane."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import integrate, stats
from scipy.spatial.transform import Rotation

from scanner_sim.acceptance import verdicts
from scanner_sim.acceptance.plan import AcceptancePlan, Ball, LengthBar, Plate
from scanner_sim.acceptance.setup import Setup, Surface, _unlimited, _untestable
from scanner_sim.acceptance.shapes import Cloud, fit_plane, fit_sphere
from scanner_sim.acceptance.verdicts import Verdict
from scanner_sim.foundation.errors import InputError

BAR = LengthBar(name="bar", position=(0.0, 0.0, 4.0), direction="x", length=0.5, diameter=0.1)
BALL = Ball(name="ball", position=(0.0, 0.0, 3.0), diameter=0.2)
PLATE = Plate(name="plate", position=(0.0, 0.0, 5.0), size=(0.4, 0.3))


class Points:
    """A cloud that knows only its name and what was cut out of it."""

    def __init__(self, name: str, count: int) -> None:
        self.name, self.points = name, np.zeros((count, 3))

    def chosen(self, where: str) -> Points:
        return Points(f"{where} of {self.name}", len(self.points) - 3)


def of_three(monkeypatch: pytest.MonkeyPatch, missing: str = "") -> tuple[Any, list[Any]]:
    """Return a test of a bar, a ball and a plate, measured twice, and a list of the fits that are asked for."""
    names = ("bar/first", 0), ("bar/second", 0), ("ball", 1), ("plate", 2)
    surfaces = [SimpleNamespace(name=name, artefact=artefact) for name, artefact in names]

    def clouds(*_: Any, **__: Any) -> Any:
        for size, surface in enumerate(surfaces):
            yield surface, tuple(Points(f"{surface.name} {turn}", 40 + size - turn) for turn in (1, 2))

    def fitted(kind: str) -> Any:
        def fit(cloud: Points, discarded: float, generator: Any) -> str | None:
            asked.append((discarded, generator))
            return None if cloud.name == missing else f"{kind} of {cloud.name}"

        return fit

    asked: list[Any] = []
    monkeypatch.setattr(verdicts, "measured_clouds", clouds)
    monkeypatch.setattr(verdicts, "fit_sphere", fitted("sphere"))
    monkeypatch.setattr(verdicts, "fit_plane", fitted("plane"))
    monkeypatch.setattr(
        verdicts, "on_plate", lambda plate, surface, points: f"{len(points)} on {surface.name}"
    )
    monkeypatch.setattr(verdicts, "host_generator", lambda seed, _, number: (seed, number))
    monkeypatch.setattr(verdicts, "_results", lambda *given: [given[1:]])
    artefacts = {("lengths", 0): BAR, ("spheres", 0): BALL, ("plates", 0): PLATE}
    plan = SimpleNamespace(artefacts=artefacts, seed=7, discarded=0.02)
    return SimpleNamespace(plan=plan, surfaces=surfaces), asked


def test_each_repetition_of_an_artefact_is_judged_by_all_of_its_surfaces(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: a bar by both of its balls of the same repetition, a plate by a plane through what lies on it; results
    come by artefact and then by repetition, which count from 1, and the fits that are kept are those of the first."""
    setup, asked = of_three(monkeypatch)
    found: Any = verdicts.accept(setup)
    assert list(found.results) == [
        (0, 1, ("sphere of bar/first 1", "sphere of bar/second 1")),
        (0, 2, ("sphere of bar/first 2", "sphere of bar/second 2")),
        (1, 1, ("sphere of ball 1",)),
        (1, 2, ("sphere of ball 2",)),
        (2, 1, ("plane of 42 on plate of plate 1",)),
        (2, 2, ("plane of 41 on plate of plate 2",)),
    ]
    assert found.fits == {
        "bar/first": "sphere of bar/first 1",
        "bar/second": "sphere of bar/second 1",
        "ball": "sphere of ball 1",
        "plate": "plane of 42 on plate of plate 1",
    }
    assert found.setup is setup
    assert {share for share, _ in asked} == {0.02}
    assert [asked[2 * number][1] for number in range(4)] == [(7, 2), (7, 3), (7, 4), (7, 5)]


@pytest.mark.parametrize("turn", [1, 2])
def test_one_repetition_without_a_fit_is_said_with_the_fewest_points(
    monkeypatch: pytest.MonkeyPatch, turn: int
) -> None:
    setup, _ = of_three(monkeypatch, missing=f"ball {turn}")
    with pytest.raises(InputError, match="ball gives 40 valid points at least"):
        verdicts.accept(setup)


def before(**changes: Any) -> tuple[Any, Surface]:
    """Return an instrument that reaches 0.4 rad and sees from 1 to 6 m, and a surface well within that."""
    made: dict[str, Any] = {
        "name": "one", "artefact": 0, "is_plate": False, "horizontal": (-0.1, 0.2), "vertical": (-0.05, 0.15),
        "nearest": 2.0, "farthest": 3.0, "extent": 0.06, "spot": 4e-3,
    }  # fmt: skip
    scanner = SimpleNamespace(
        mirrors=SimpleNamespace(max_deflection=0.4),
        seen_by={"tof": (1.0, 6.0), "triangulation": (2.5, 2.6)}.get,
    )
    return SimpleNamespace(base=SimpleNamespace(scanner=scanner), rangefinder="tof"), Surface(
        **made | changes
    )


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        ({"horizontal": (-0.39, 0.1)}, "", ""),
        ({"horizontal": (-0.41, 0.1)}, "position", "turn by 23.5 deg, and reach 22.9 deg"),
        ({"horizontal": (0.1, 0.41)}, "position", "turn by 23.5 deg"),
        ({"vertical": (-0.41, 0.1)}, "position", "turn by 23.5 deg"),
        ({"vertical": (0.1, 0.41)}, "position", "turn by 23.5 deg"),
        ({"nearest": 1.02}, "", ""),
        ({"nearest": 0.98}, "position", "between 0.98 m and 3 m, and the tof of the scanner measures from 1 m to 6 m"),
        ({"farthest": 5.9}, "", ""),
        ({"farthest": 6.1}, "position", "between 2 m and 6.1 m"),
        ({"nearest": 0.0}, "position", "behind the scanner or around it"),
        ({"extent": 0.0202}, "", ""),
        ({"extent": 0.0198}, "diameter", "19.8 mm is too small for the beam of 4 mm (1/e²) there"),
        ({"extent": 0.0404, "is_plate": True}, "", ""),
        ({"extent": 0.0396, "is_plate": True}, "size", "39.6 mm is too small"),
    ],
)  # fmt: skip
def test_what_cannot_be_tested_has_its_reason(changes: dict[str, Any], key: str, words: str) -> None:
    """Claim: all of an artefact lies where the mirrors reach and ranges are measured; a ball is 5 beams wide, the
    smaller edge of a plate 10; just inside nothing is said, and just outside why, with the sizes that would do."""
    setup, surface = before(**changes)
    found = list(_untestable(setup, surface))
    assert [one[0] for one in found] == ([key] if key else [])
    if key:
        assert words in found[0][1]
    if key in {"diameter", "size"}:
        assert f"Make it {20 if key == 'diameter' else 40} mm or more" in found[0][2]


@pytest.mark.parametrize(
    ("kind", "stated", "missing"),
    [
        ("lengths", ("length",), ""),
        ("spheres", ("size",), ""),
        ("spheres", ("form",), ""),
        ("plates", ("flatness",), ""),
        ("lengths", ("size", "form", "flatness"), "length"),
        ("spheres", ("length", "flatness"), "size or form"),
        ("plates", ("length", "size", "form"), "flatness"),
    ],
)
def test_one_limit_is_enough_of_what_an_artefact_tests(
    kind: str, stated: tuple[str, ...], missing: str
) -> None:
    limits = dict.fromkeys(("length", "size", "form", "flatness")) | dict.fromkeys(stated, 1e-3)
    near, far = (SimpleNamespace(up_to=up_to, **limits) for up_to in (2.0, 4.0))
    artefacts = {"a": BAR, "b": SimpleNamespace(name="this one")}
    plan = SimpleNamespace(limits=[near, far], artefacts=artefacts)
    surfaces = [SimpleNamespace(artefact=0, farthest=9.0), SimpleNamespace(artefact=1, farthest=3.0)]
    setup: Any = SimpleNamespace(
        plan=plan, surfaces=surfaces, zone_of=lambda number: Setup.zone_of(setup, number)
    )
    document: Any = SimpleNamespace(line=lambda steps: steps)
    found = list(_unlimited(setup, 1, kind, 5, document))
    assert [one.location for one in found] == (["limits[1]"] if missing else [])
    if missing:
        assert found[0].problem == f"there is no limit for {missing}, which this one tests."
        assert found[0].line == ("limits", 1)


def test_uneven_light_counts_along_the_beam_and_is_no_noise_of_a_plane() -> None:
    """Claim: variance w along the beam adds w (n·b)² to that of a point across its plane; the slopes and the offset of
    symmetric points then have Σ x² v / (Σ x²)² and Σ v / n², the noise alone without w, of which the form is. A shared
    tilt of one in 2000 of x adds its square to that slope alone, to both, and nothing to the form.

    Tolerance: of the form as of Tippett's mean range, three degrees of freedom of 400 and 400 draws.
    """
    side = np.linspace(-1.0, 1.0, 20)
    x, y = (axis.ravel() for axis in np.meshgrid(0.3 * side, 0.2 * side))
    turn = Rotation.from_rotvec([0.4, -0.9, 0.2]).as_matrix()
    points = np.column_stack([x, y, 0.0 * x]) @ turn.T + [0.7, -0.4, 2.5]
    beam = points / np.linalg.norm(points, axis=1)[:, None]
    sigma, uneven = 2e-4, 1e-6 * (1.5 + np.sin(17.0 * x + 5.0 * y))
    covariance = sigma**2 * np.eye(3) + uneven[:, None, None] * beam[:, :, None] * beam[:, None]
    tilt = 5e-4 * x[:, None, None] * turn[:, 2][:, None]
    none = np.zeros((len(x), 3, 0))
    fit = fit_plane(Cloud(points, covariance, tilt, none, uneven), 0.0, np.random.default_rng(4))
    assert fit is not None
    whole = sigma**2 + uneven * (beam @ turn[:, 2]) ** 2
    for found, v in ((fit.covariance, whole), (fit.noise, np.full(len(x), sigma**2))):
        wanted = [
            (x**2 * v).sum() / (x @ x) ** 2 + 5e-4**2,
            (y**2 * v).sum() / (y @ y) ** 2,
            v.sum() / len(v) ** 2,
        ]
        np.testing.assert_allclose(np.diag(found), wanted, rtol=1e-9)
    np.testing.assert_allclose(fit.deviations, 0.0, atol=1e-12)
    normal = stats.norm.cdf
    mean, _ = integrate.quad(lambda at: 1.0 - normal(at) ** 400 - (1.0 - normal(at)) ** 400, -9.0, 9.0)
    assert fit.expected_form == pytest.approx(sigma * mean, rel=0.03)


@pytest.mark.parametrize(
    ("up_to", "faulty"), [((3.0, 3.01, 9.0), []), ((3.0, 3.0, 9.0), [1]), ((3.0, 5.0, 4.9), [2])]
)
def test_each_zone_ends_beyond_the_one_before(up_to: tuple[float, ...], faulty: list[int]) -> None:
    plan: Any = SimpleNamespace(
        artefacts={("spheres", 0): BALL}, limits=[SimpleNamespace(up_to=one) for one in up_to]
    )
    found = AcceptancePlan.cross_checks(plan)
    assert [one.location for one in found] == [f"limits.{number}.up_to" for number in faulty]


@pytest.mark.parametrize("count", [29, 30])
def test_thirty_points_make_a_result(count: int) -> None:
    """Claim: a plane and a sphere of 30 points are fitted, of fewer they are not; steep points of a sphere do not
    count, however many there are."""
    rng = np.random.default_rng(2)
    way = rng.normal(size=(60, 3))
    way[:, 2] = -np.abs(way[:, 2]) - 1.5 * np.hypot(way[:, 0], way[:, 1])
    way[count:, 2] = 0.2
    way /= np.linalg.norm(way, axis=1)[:, None]

    def cloud(points: Any) -> Cloud:
        none = np.zeros((len(points), 3, 0))
        return Cloud(
            points, np.tile(1e-8 * np.eye(3), (len(points), 1, 1)), none, none, np.zeros(len(points))
        )

    ball, flat = 0.1 * way + [0.0, 0.0, 3.0], way * [1.0, 1.0, 0.0] + [0.0, 0.0, 3.0]
    for found in (
        fit_sphere(cloud(ball), 0.0, rng), fit_sphere(cloud(ball[:count]), 0.0, rng),
        fit_plane(cloud(flat[:count]), 0.0, rng),
    ):  # fmt: skip
        assert (found is not None) == (count == 30)
    whole = fit_sphere(cloud(ball), 0.0, rng)
    assert whole is None or whole.used.sum() == 30


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("error", "rule", "verdict"),
    [
        (0.749, "guarded", Verdict.PASSES), (0.751, "guarded", Verdict.UNDECIDED),
        (1.249, "guarded", Verdict.UNDECIDED), (1.251, "guarded", Verdict.FAILS),
        (0.999, "simple", Verdict.PASSES), (1.001, "simple", Verdict.FAILS),
    ],
)  # fmt: skip
def test_an_uncertainty_leaves_as_much_open_on_either_side(
    error: float, rule: str, verdict: Verdict, sign: float
) -> None:
    """Claim: of a limit of 1 and an uncertainty of ¼ all between ¾ and 1¼ is open, and nothing by the simple rule."""
    assert verdicts.decide(sign * error, 1.0, 0.25, rule) is verdict
