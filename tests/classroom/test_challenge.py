"""The challenge: scores are those of `evaluate`, and a bad submission costs only itself."""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from uavdh_lite.city import City
from uavdh_lite.cli.main import main
from uavdh_lite.course.challenge import referee, wire
from uavdh_lite.course.challenge.board import Challenge, Leaderboard, score
from uavdh_lite.course.challenge.referee import Submission, SubmissionFailed
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy
from uavdh_lite.scenario import SCENARIOS
from uavdh_lite.storage import data_folder
from uavdh_lite.streams import Use, stream

pytestmark = pytest.mark.long  # each submission is a process of its own, some of which hang

SMALL = Challenge("village", episodes=40)
GREEDY = """
import numpy as np
from uavdh_lite.planners import Greedy

planners = {}

def policy(environment, state):
    print("what a policy prints does no harm")
    planner = planners.setdefault("greedy", Greedy(environment))
    return planner(state)
"""
WAIT = "import numpy as np\n\ndef policy(environment, state):\n    "


@pytest.fixture
def submit(tmp_path):
    def write(text, name="submission.py"):
        path = tmp_path / name
        path.write_text(text)
        return str(path)

    return write


def test_a_policy_in_its_own_process_scores_what_it_scores_in_this_one(submit):
    own = score(SMALL, submit(GREEDY))
    known = score(SMALL, "greedy")
    environment = Environment(City.load("village"))
    metrics = evaluate(
        environment, Greedy(environment), SCENARIOS["village"], 40, SMALL.seed, Use.CHALLENGE
    ).metrics()
    assert own.failed is None and own.name == "submission"
    for name in ("cral", "has_landed", "cumulative_reward"):
        long = "collection_ratio_and_landed" if name == "cral" else name
        assert getattr(own, name) == getattr(known, name) == tuple(metrics[long])


def test_a_checkpoint_scores_what_the_shipped_agent_scores():
    challenge = Challenge("manhattan", episodes=20)
    file = score(challenge, str(data_folder() / "checkpoints" / "manhattan.safetensors"))
    assert file.failed is None and file.cral == score(challenge, "manhattan").cral


def test_scenarios_of_a_challenge_are_not_those_of_the_tests():
    scenario, city = SCENARIOS["village"], City.load("village")
    starts = [
        scenario.sample(city, 50, stream(use, 0)).device_cells for use in (Use.TEST, Use.CHALLENGE)
    ]
    assert (starts[0] != starts[1]).any()


@pytest.mark.parametrize(
    "text, message",
    [
        ("x = 1", "no function policy"),
        ("import nothing_like_it", "No module named 'nothing_like_it'"),
        ("def policy(", "SyntaxError"),
        (WAIT + "raise RuntimeError('lost my way')", "RuntimeError: lost my way"),
        (WAIT + "return None", "policy gave back NoneType, expected an array"),
        (WAIT + "return np.zeros(len(state))", "answered float64 of shape"),
        (WAIT + "return np.zeros(len(state) + 1, int)", "expected as many whole numbers"),
        (WAIT + "return np.full(len(state), 6)", "an action of 6"),
        (WAIT + "return np.full(len(state), -1)", "an action of -1"),
        (WAIT + "import os; os._exit(7)", "stopped: exit status 7"),
        (WAIT + "import sys; sys.exit('enough')", "stopped: enough"),
    ],
)
def test_what_goes_wrong_is_the_submission_s_own(submit, text, message):
    result = score(SMALL, submit(text))
    assert message in result.failed and result.cral is None


@pytest.mark.parametrize("text", [WAIT + "while True: pass", "import time; time.sleep(1000)"])
def test_a_hang_ends_with_the_time(submit, text):
    started = time.monotonic()
    assert score(SMALL, submit(text), seconds=3).failed == "took more than 3 s"
    assert time.monotonic() - started < 60


def test_a_hog_ends_with_the_memory(submit):
    hog = "import time, numpy as np\nkept = np.ones(2**28)\ntime.sleep(1000)"  # 2 GB
    assert "MB, more than 1000" in score(SMALL, submit(hog), memory_mb=1000).failed


def test_nothing_that_a_submission_started_stays(submit, tmp_path):
    note = tmp_path / "child"
    text = (
        "import subprocess, sys, time\n"
        "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(1000)'])\n"
        f"open({str(note)!r}, 'w').write(str(child.pid))\ndef policy(environment, state): pass"
    )

    def lives():
        return psutil.pid_exists(child) and psutil.Process(child).status() != "zombie"

    with Submission(Path(submit(text)), "village"):
        child = int(note.read_text())
        assert lives()
    killed = time.monotonic()
    while lives():  # for the moment that the kill takes
        assert time.monotonic() - killed < 60
        time.sleep(0.05)


def test_a_submission_finds_the_library_where_the_referee_has_it(submit, tmp_path):
    note = tmp_path / "path"
    text = f"import sys\nopen({str(note)!r}, 'w').write('\\n'.join(sys.path))\npolicy = print"
    with Submission(Path(submit(text)), "village"):
        folders = [Path(folder) for folder in note.read_text().split("\n") if folder]
    assert Path(referee.__file__).parents[3] in folders
    assert not [folder for folder in folders if folder.name == "uavdh_lite"]


def test_a_submission_cannot_change_the_flight(submit):
    cheat = GREEDY.replace(
        "    planner =",
        "    type(environment).forbidden = np.zeros_like(environment.forbidden)\n"
        "    for name, value in (('data_left', 0), ('time_left', 99)):\n"
        "        array = np.full_like(getattr(state, name), value)\n"
        "        object.__setattr__(state, name, array)\n"
        "    planner =",
    )
    with Submission(Path(submit(cheat)), "village") as policy:
        environment, scenario = Environment(City.load("village")), SCENARIOS["village"]
        flights = evaluate(environment, policy, scenario, 40, 0, Use.CHALLENGE)
    assert flights.records()["collection_ratio_and_landed"].mean() < 0.9
    assert (flights.steps <= flights.start.time_left).all()


def test_foreign_bytes_are_no_message(tmp_path):
    pipe = tmp_path / "pipe"
    for data, error in (
        (b"", EOFError),
        (b"\x05", EOFError),
        (b"\x05" + 7 * b"\0" + b"wrong", ValueError),
        (8 * b"\xff", ValueError),
    ):
        pipe.write_bytes(data)
        with open(pipe, "rb") as file, pytest.raises(error):
            wire.receive(file)


def test_a_pickle_is_no_message(tmp_path):
    with open(tmp_path / "pipe", "wb") as file:
        wire.send(file, action=np.array([print], object))
    with open(tmp_path / "pipe", "rb") as file, pytest.raises(ValueError, match="not a message"):
        wire.receive(file)


def test_hidden_scenarios(tmp_path):
    first, second = (Challenge.hidden("village", 40) for _ in range(2))
    assert first.seed != second.seed and first.fingerprint != second.fingerprint
    path = tmp_path / "secret.json"
    first.save(path)
    assert Challenge.load(path) == first
    with pytest.raises(InputError, match="its missions would be lost"):
        second.save(path)
    path.write_text("[]")
    with pytest.raises(InputError, match="expected a JSON object"):
        Challenge.load(path)
    path.write_text('{"scenario": "village"}')
    with pytest.raises(InputError, match="not a challenge"):
        Challenge.load(path)
    with pytest.raises(InputError, match="unknown scenario"):
        Challenge.hidden("nowhere", 40)


def test_leaderboard(submit, tmp_path, capsys):
    board = Leaderboard(tmp_path / "board.json")
    good = score(SMALL, submit(GREEDY, "ours.py"))
    board.add(SMALL, score(SMALL, "random"))
    board.add(SMALL, good)
    board.add(SMALL, score(SMALL, submit("x = 1", "ours.py")))  # must not cost the good score
    table = board.table()
    assert table.index("| 1 | ours |") < table.index("| 2 | random |")
    assert "- ours, " in table and "no function policy" in table
    assert str(SMALL.seed) not in json.loads(board.path.read_text())
    with pytest.raises(InputError, match="board of another challenge"):
        board.add(Challenge("village", 41), good)
    board.path.write_text("broken")
    with pytest.raises(InputError, match="not JSON"):
        board.add(SMALL, good)
    assert board.path.read_text() == "broken"


def test_commands(submit, tmp_path, capsys):
    secret, board = str(tmp_path / "secret.json"), str(tmp_path / "board.json")
    assert main(["challenge", "new", secret, "--scenario", "village", "--episodes", "30"]) == 0
    files = [submit(GREEDY, "ours.py"), submit("x = 1", "theirs.py")]
    scored = ["challenge", "score", *files, "greedy", "--secret", secret, "--leaderboard", board]
    assert main(scored) == 0
    assert "theirs                  failed: stopped: " in capsys.readouterr().out
    assert main(["challenge", "show", board]) == 0
    assert "| 1 | ours |" in capsys.readouterr().out
    assert main(["challenge", "score", "nobody.py"]) == 2
    assert main(["challenge", "show", str(tmp_path / "none.json")]) == 2
    assert "no such leaderboard" in capsys.readouterr().err


def test_the_pilot_runs_without_the_repository_at_hand(submit, tmp_path):
    """From any folder, as the referee starts it, with the library found by its path."""
    code = "import uavdh_lite.course.challenge.pilot as p; print(p.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=referee._environment(),
        capture_output=True,
        text=True,
        check=True,
    )
    assert "pilot.py" in done.stdout


def test_a_failed_start_leaves_no_process(submit):
    before = len(psutil.Process().children())
    with pytest.raises(SubmissionFailed), Submission(Path(submit("x = 1")), "village"):
        pass
    assert len(psutil.Process().children()) == before
