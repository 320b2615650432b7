"""A track that another program steers: the bytes of a run, what is refused, and what is saved."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
import zmq
from same_bytes import content
from scipy.spatial.transform import Rotation
from serving import serving
from typer.testing import CliRunner

from scanner_sim import InputError, PoseFilter, Scenario, Tracker, load_scenario, track
from scanner_sim.cli import app
from scanner_sim.config import scenario_from_text
from scanner_sim.serve.messages import read_request
from scanner_sim.serve.session import Session

pytestmark = pytest.mark.usefixtures("device")

ROOT = Path(__file__).resolve().parents[2]
SCENARIO = """\
schema: 1
seed: 4
scene:
  objects:
    - name: node
      array: {diameter: 100 mm, plate: 300 mm, rows: 2, columns: 2, spacing: [0.4 m, 0.4 m]}
      position: [0.125 m, 0 m, 7 m]
      motion: {type: twist, velocity: [20 mm/s, 0 m/s, 0 m/s]}
scan: {type: track, targets: [node], duration: 0.15 s}
transport: {pattern_beamlets: 19, background_samples: 2}
output: {pictures: false}
"""


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("served") / "node.yaml"
    file.write_text(SCENARIO, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def scenario(config: Path) -> Scenario:
    return load_scenario(config)


@pytest.fixture(scope="module")
def session(scenario: Scenario, device: Any) -> Session:
    """A session of whose run the tests do not care."""
    made = Session(scenario)
    ask(made, "step", visits=2)
    return made


def ask(session: Session, command: str, **keys: Any) -> dict[str, Any]:
    """Ask over the form that the socket has, without the socket."""
    sent = msgpack.unpackb(msgpack.packb({"protocol": 1, "command": command} | keys))
    answer: dict[str, Any] = session.answer(read_request(sent))
    return answer


def test_steps_make_the_records_of_a_track(scenario: Scenario) -> None:
    """Claim: a run that is stepped, five visits at a time and more than there are at its end, is the run of `track`;
    what is asked between does not change it, and records say the bits of what was measured."""
    session, told = Session(scenario), []
    assert ask(session, "open")["targets"][3]["centre"] == session.tracker.targets[3].centre.tolist()
    while not (answer := ask(session, "step", visits=5, truth=True))["finished"]:
        told += answer["records"]
        ask(session, "state")
        ask(session, "pose")
    told += answer["records"]
    assert ask(session, "step")["records"] == []
    whole = track(scenario)
    assert content(session.records) == content(list(whole.records))
    assert session.track.scenario_yaml == whole.scenario_yaml
    for one, record in zip(told, whole.records, strict=True):
        np.testing.assert_array_equal(one["position"], record.position)
        np.testing.assert_array_equal(one["truth"], record.truth)
        np.testing.assert_array_equal(one["covariance"], record.covariance)
        np.testing.assert_allclose(np.add(one["white"], one["lasting"]), record.covariance, rtol=1e-9)
        assert one["sigma_range"] == np.sqrt(record.covariance[2, 2]) or np.isnan(one["sigma_range"])
    fed = PoseFilter(whole.targets, axis_separation=scenario.scanner.mirrors.axis_separation)
    for record in whole.records:
        fed.update(record)
    pose, known = ask(session, "pose")["pose"], fed.predict(session.tracker.time)
    np.testing.assert_array_equal(pose["position"], known.position)
    np.testing.assert_array_equal(pose["covariance"], known.covariance)
    assert pose["status"] == known.status.value


def test_moves_by_message_are_those_of_a_tracker(scenario: Scenario) -> None:
    """Claim: object, position, attitude, velocity, rates and time of a message arrive where `Tracker.move` has them."""
    session, tracker = Session(scenario), Tracker(scenario)
    for visit in range(6):
        time = tracker.time + 1e-3
        turn, place = Rotation.from_rotvec([0.02 * visit, 0.01, -0.03]), [0.13, 0.001 * visit, 7.0]
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn.as_matrix(), place
        rates: dict[str, Any] = {"velocity": (0.0, 0.02, 0.1), "turn_rate": (0.0, 0.0, 0.1), "time": time}
        tracker.move("node", pose, **rates)
        x, y, z, w = turn.as_quat().tolist()
        ask(session, "move", object="node", position=place, quaternion=[w, x, y, z], **rates)
        ask(session, "step")
        record = next(tracker)
        np.testing.assert_allclose(session.records[-1].truth, record.truth, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(session.records[-1].position, record.position, atol=1e-7)


def test_a_step_carries_moves(session: Session, scenario: Scenario) -> None:
    """Claim: moves within a step are moves before it, to the byte; where one of them is refused nothing is told and no
    visit is made, whichever it is."""
    apart = Session(scenario)
    ask(apart, "step", visits=2)
    time = apart.tracker.time
    first = {"object": "node", "position": [0.1, 0.02, 7.0], "velocity": [0.0, 0.1, -0.2], "time": time}
    later = {
        "object": "node",
        "position": [0.1, 0.02, 7.1],
        "quaternion": [1.0, 1e-3, 0.0, 0.0],
        "time": time + 1e-3,
    }
    told = ask(session, "step", visits=3, moves=[first, later], truth=True)
    ask(apart, "move", **first)
    ask(apart, "move", **later)
    assert told == ask(apart, "step", visits=3, truth=True)
    assert session.tracker.scenario_yaml == apart.tracker.scenario_yaml
    assert told["records"][0]["truth_point"][2] > 6.9
    before = session.tracker.state, session.tracker.scenario
    last = {**later, "time": session.tracker.time}
    for wrong in ({"object": "wall"}, {"quaternion": [0.0, 0.0, 0.0, 2.0]}, {"time": 0.0}):
        for moves in ([last | wrong, last], [last, last | wrong]):
            with pytest.raises(InputError):
                ask(session, "step", moves=moves)
            assert (session.tracker.state, session.tracker.scenario) == before


def test_light_by_message_is_that_of_a_tracker() -> None:
    """Claim: under the Sun directions and share of a message arrive where `Tracker.light` has them, and change what is
    measured: with a hundredth of the light the background beneath the spots is less."""
    sun = "lighting: {sun: {direction: [-0.35, -0.45, -0.8]}}\n"
    sunlit = scenario_from_text(SCENARIO + sun, name="sunlit.yaml")
    session, tracker = Session(sunlit), Tracker(sunlit)
    told: dict[str, Any] = {"sun": [-0.1, -0.6, -0.8], "visible": 0.01}
    for number in range(2):
        if number:
            tracker.light(**told)
            ask(session, "light", **told)
        ask(session, "step")
        assert content([session.records[-1]]) == content([next(tracker)])
    sigmas = [float(np.nanmedian(record.samples.sigma_signal)) for record in session.records]
    assert sigmas[1] < sigmas[0]


def test_other_commands_do_what_the_tracker_does(scenario: Scenario) -> None:
    session = Session(scenario)
    ask(session, "drop", target="node/1")
    ask(session, "amplitude", target="node/2", amplitude=0.02)
    answer = ask(session, "step", voxels=True)
    (record,) = answer["records"]
    assert (record["target"], record["amplitude"]) == ("node/2", 0.02)
    assert record["voxels"]["range"]["shape"] == [session.records[0].samples.range.shape[1]]
    ask(
        session,
        "point",
        target="node/1",
        theta=0.0,
        phi=0.0,
        range=7.0,
        rates=[0, 0, 0],
        covariance=np.eye(3).tolist(),
    )
    ask(session, "search", target="node/1")
    state = ask(session, "state")
    assert all(target["followed"] for target in state["targets"])
    assert ask(session, "wait", time=0.1)["time"] == 0.1
    raster = ask(session, "raster", rows=3, columns=4, horizontal=[-0.02, 0.02], vertical=[-0.02, 0.02])
    assert raster["raster"]["layers"]["range_m"]["shape"] == [3, 4]
    assert raster["time"] > 0.1


@pytest.mark.parametrize(
    ("command", "keys", "said"),
    [
        ("move", {"object": "wall", "position": [0, 0, 5]}, "no object 'wall'"),
        ("move", {"object": "node", "position": [0, 0, 5], "time": 0.0}, "everything is measured"),
        ("move", {"object": "node", "position": [0, 0, 5], "quaternion": [0, 0, 0, 0]}, "is no attitude"),
        ("wait", {"time": 0.0}, "is before"),
        ("light", {"visible": 0.5}, "no light to change"),
        ("search", {"target": "node/9"}, "no target 'node/9'"),
        ("point", {"target": "node/1", "theta": 99.0, "phi": 0.0, "range": 5.0}, "is no place"),
        ("amplitude", {"target": "node/1", "amplitude": 9.0}, "is no amplitude"),
        ("raster", {"rows": 2, "columns": 2, "horizontal": [-9, 9], "vertical": [-0.1, 0.1]}, ""),
        ("pose", {"object": "moon"}, "knows no 'moon'"),
        ("sight", {"target": "node/1"}, "knows no pose yet"),
        ("save", {}, "saves nothing"),
    ],
)
def test_the_impossible_is_refused_and_the_run_goes_on(
    session: Session, command: str, keys: dict[str, Any], said: str
) -> None:
    before = session.tracker.state, session.tracker.scenario
    with pytest.raises(InputError) as caught:
        ask(session, command, **keys)
    assert said in caught.value.message
    assert caught.value.remedy
    assert (session.tracker.state, session.tracker.scenario) == before


def test_a_state_of_other_targets_is_refused(session: Session, scenario: Scenario, tmp_path: Path) -> None:
    session.tracker.save(tmp_path / "run.state")
    other = scenario.changed(
        scene={"objects": (scenario.scene.objects[0].changed(name="port"),)}, scan={"targets": ("port",)}
    )
    with pytest.raises(InputError, match="a state of other targets: node/1"):
        Session(other, resume=tmp_path / "run.state")
    (tmp_path / "run.state").write_text("{}", encoding="utf-8")
    with pytest.raises(InputError, match="no state of a tracker"):
        Session(scenario, resume=tmp_path / "run.state")


class Client:
    def __init__(self, address: str) -> None:
        self.socket = zmq.Context.instance().socket(zmq.REQ)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.connect(address)

    def __call__(self, command: str, **keys: Any) -> dict[str, Any]:
        self.socket.send(msgpack.packb({"protocol": 1, "command": command} | keys))
        assert self.socket.poll(60_000), "the server hangs"
        answer: dict[str, Any] = msgpack.unpackb(self.socket.recv())
        return answer


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.pinned
@pytest.mark.slow
def test_a_served_run_writes_the_files_of_a_run(config: Path, tmp_path: Path) -> None:
    """Claim: nothing moved, the folder of a served run is that of `run`, byte for byte: though a first client died in
    the middle, garbage came, a second one went on, and two threads computed it."""
    run = CliRunner().invoke(app, ["run", str(config), "-q", "-o", str(tmp_path / "run")])
    assert run.exit_code == 0, run.output
    asked = ["-o", str(tmp_path / "served"), "--patience", "0.2", "--threads", "2"]
    with serving(config, "-q", *asked) as (process, address):
        first, second = Client(address), Client(address)
        assert first("open")["ok"]
        assert first("step", visits=3)["ok"]
        first.socket.send(b"\xc1garbage")
        first.socket.close()
        while not second("open")["ok"]:
            pass
        while not second("step", visits=4)["finished"]:
            pass
        assert second("close", stop=True)["ok"]
        second.socket.close()
    assert process.returncode == 0
    assert files(tmp_path / "served") == files(tmp_path / "run")


@pytest.mark.pinned
@pytest.mark.slow
def test_an_interrupt_saves_and_the_run_goes_on(config: Path, scenario: Scenario, tmp_path: Path) -> None:
    """Claim: Ctrl-C ends with status 130, state and files; a resumed run makes the rest, to the bit."""
    whole = track(scenario).records
    with serving(config, "-o", str(tmp_path / "first")) as (process, address):
        client = Client(address)
        client("open")
        client("step", visits=6)
        process.send_signal(signal.SIGINT)
        assert process.stderr is not None
        said = process.stderr.read()
        client.socket.close()
    assert process.returncode == 130
    assert f"--resume {tmp_path / 'first.state'}" in said
    assert "stopped: interrupted" in said
    assert "Traceback" not in said
    assert (tmp_path / "first" / "track.csv").exists()
    with serving(config, "-q", "-o", str(tmp_path / "rest"), "--resume", str(tmp_path / "first.state")) as (
        _,
        address,
    ):
        client = Client(address)
        assert client("open")["visits"] == 6
        rest = client("step", visits=100)["records"]
        client("close", stop=True)
        client.socket.close()
    assert [one["number"] for one in rest] == [record.number for record in whole[6:]]
    for one, record in zip(rest, whole[6:], strict=True):
        np.testing.assert_array_equal(one["position"], record.position)


DRIFTING = ROOT / "configs" / "track_moving.yaml"
"""What the examples are written for."""
SHORT = ("-q", "--set", "scan.duration=0.3 s", "--set", "output.pictures=false")


@pytest.mark.slow
def test_the_example_in_python_runs(tmp_path: Path) -> None:
    with serving(DRIFTING, *SHORT, "-o", str(tmp_path / "out")) as (process, address):
        command = [sys.executable, str(ROOT / "docs/examples/client.py"), address, "30"]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
        assert done.returncode == 0, done.stderr
    assert process.returncode == 0
    assert "node is following" in done.stdout
    assert "of 64 voxels have a range" in done.stdout


def can_compile() -> bool:
    """Whether there is a compiler, and the header files of libzmq and msgpack-c."""
    if shutil.which("g++") is None:
        return False
    source = "#include <zmq.h>\n#include <msgpack.hpp>\n"
    command = ["g++", "-std=c++17", "-M", "-x", "c++", "-"]
    return subprocess.run(command, input=source, text=True, capture_output=True, check=False).returncode == 0


@pytest.mark.slow
def test_the_example_in_cpp_runs(tmp_path: Path) -> None:
    if not can_compile():
        pytest.skip("needs g++, libzmq3-dev and libmsgpack-cxx-dev")
    source, program = ROOT / "docs" / "examples" / "client.cpp", tmp_path / "client"
    flags = ["-std=c++17", "-Wall", "-Wextra", "-Werror"]
    subprocess.run(["g++", *flags, str(source), "-o", str(program), "-lzmq"], check=True)
    with serving(DRIFTING, *SHORT, "-o", str(tmp_path / "out")) as (process, address):
        done = subprocess.run(
            [str(program), address, "12"], capture_output=True, text=True, check=False, timeout=300
        )
        assert done.returncode == 0, done.stderr
        process.send_signal(signal.SIGTERM)
    assert done.stdout.count(" m ± ") > 6


@pytest.mark.slow
def test_what_is_open_to_others_is_said_aloud(config: Path, tmp_path: Path) -> None:
    """Claim: a bound address beyond loopback is warned of on the standard error stream; a wrong one ends with 2."""
    with serving(config, "-o", str(tmp_path / "out"), "--bind", "tcp://0.0.0.0:*") as (process, _):
        process.send_signal(signal.SIGTERM)
        assert process.stderr is not None
        said = " ".join(process.stderr.read().split())
    assert "is open to other computers: whoever reaches it steers this run" in said
    assert "stopped: terminated" in said
    assert process.returncode == 143
    done = CliRunner().invoke(app, ["serve", str(config), "--bind", "5555"])
    assert done.exit_code == 2
    assert "'5555' is no address to bind" in done.stderr
