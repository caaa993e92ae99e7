"""Attacks: what a student wrote changes nothing but its own points, and learns nothing."""

import hashlib
import json
import os
import re
import shutil
import socket
import sqlite3
import subprocess
import threading
import time
from pathlib import Path

import nbformat
import pytest
from mutants import SCRIPTS, solutions

from uavdh_lite.course import checks, walls
from uavdh_lite.course.challenge import Challenge, score
from uavdh_lite.course.walls import Lost, Walled, judged
from uavdh_lite.errors import InputError

pytestmark = pytest.mark.skipif(not shutil.which("bwrap"), reason="bubblewrap is not installed")
NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
SECRET = "8642097531"
RIGHT = "import numpy as np\ndef f(x): return np.log2(1 + 10 ** (x / 10))\n"
SEARCH = """
import os, uavdh_lite.course
for root in ("/", *uavdh_lite.course.__path__):
    for folder, inside, files in os.walk(root):
        inside[:] = [one for one in inside if one not in ("torch", "proc", "sys")]
        for file in files:
            if any(one in file for one in ("secret", ".ipynb", ".db", "notebook_01")):
                text = open(os.path.join(folder, file), errors="replace").read()
                print(text if "uavdh" in text or "seed" in text else "")
"""
LIBC = "import ctypes\nlibc = ctypes.CDLL(None, use_errno=True)\n"
# What a cell tries; COURSE is the course's folder, PID a process of its user, PORT a server's
QUIET = {
    "the grade book by its path": "open('COURSE/gradebook.db', 'ab').write(b'x')",
    "by a relative path": "open('../../../../../..COURSE/gradebook.db', 'ab').write(b'x')",
    "by a trigger": "import sqlite3\nwith sqlite3.connect('COURSE/gradebook.db') as book:\n"
    "    book.execute('create trigger t after insert on grade begin "
    "update grade set auto_score = 99; end')",
    "by /proc/self/root": "print(open('/proc/self/root/COURSE/secret.json').read())",
    "by /proc/1/root": "print(open('/proc/1/root/COURSE/secret.json').read())",
    "by another process's folder": "print(open('/proc/PID/cwd/secret.json').read())",
    "by a link": "import os\nos.symlink('COURSE/secret.json', 'l')\nprint(open('l').read())",
    "by a hard link": "import os\nos.link('COURSE/gradebook.db', '/tmp/own/g')",
    "by a search": SEARCH,
    "a list of others": "import os\nprint(os.listdir('COURSE/submitted'), os.listdir('../..'))",
    "the environment": "import os\nprint(os.environ, open('/proc/self/environ').read())",
    "others' environment": "import glob\nfor path in glob.glob('/proc/[0-9]*/environ'):\n"
    "    print(open(path).read())",
    "others' command lines": "import glob\nfor path in glob.glob('/proc/[0-9]*/cmdline'):\n"
    "    print(open(path).read())",
    "others' memory": "import os\nprint(open('/proc/PID/mem', 'rb').read(100))",
    "open files": "import os\nfor fd in range(3, 300):\n    try:\n"
    "        print(os.pread(fd, 9999, 0))\n    except OSError:\n        pass",
    "a debugger": LIBC + "print(libc.ptrace(16, PID, 0, 0))\nassert libc.ptrace(16, PID, 0, 0) < 0",
    "a signal": "import os\nos.kill(PID, 9)",
    "a signal to all": "import os, signal\nsignal.signal(15, signal.SIG_IGN)\nos.kill(-1, 15)",
    "a server of this machine": "import socket\nsocket.create_connection(('127.0.0.1', PORT), 2)",
    "the network": "import socket\nsocket.create_connection(('1.1.1.1', 53), 2)",
    "the network by a name": "import urllib.request\nurllib.request.urlopen('http://example.org')",
    "an abstract socket": "import socket\nsocket.socket(socket.AF_UNIX).connect('\\0walls-PORT')",
    "pip": "!pip install --target . numpy\n!ls",
    "another user": "import os\nos.setuid(0)",
    "a namespace of its own": LIBC + "libc.unshare(0x10020000)\n"
    "libc.mount(b'COURSE', b'/tmp/own', None, 4096, None)\nprint(open('secret.json').read())",
    "a way out of the root": "import os\nos.mkdir('d')\nos.chroot('d')\n"
    "for _ in range(99):\n    os.chdir('..')\nos.chroot('.')\n"
    "print(open('COURSE/secret.json').read())",
    "devices": "import glob\nprint(glob.glob('/dev/sd*'))\nopen('/dev/mem', 'rb').read(9)",
    "the package": "import uavdh_lite, os\n"
    "open(os.path.dirname(uavdh_lite.__file__) + '/city.py', 'a').write('x')",
    "Python": "import os\nopen(os.__file__, 'a').write('x')",
    "a module for later": "import site\nopen(site.getsitepackages()[0] + '/x.pth', 'w').write('1')",
    "the checks by import": "import inspect\n"
    "from uavdh_lite.course.checks.notebook_01 import rate_from_snr as one\n"
    "print(inspect.getsource(one.solution))",
    "a solution by its check": "print(checks.rate_from_snr.solution)",
    "the terminal": "import fcntl\nfor c in 'id\\n':\n    fcntl.ioctl(0, 0x5412, c)",
    "shared memory": "import glob\n"
    "print([open(path, 'rb').read() for path in glob.glob('/dev/shm/*')])\n"
    "open('/dev/shm/x', 'w').write('x')",
    "a script in its output": "from IPython.display import HTML, Javascript, display\n"
    "display(HTML('<script>alert(1)</script>'), Javascript('alert(1)'))",
}  # fmt: skip


@pytest.fixture(scope="module")
def course(tmp_path_factory):
    """A course with a grade book, others' work, a secret, a process and servers."""
    root = tmp_path_factory.mktemp("course") / "course"
    (root / "submitted" / "other").mkdir(parents=True)
    (root / "submitted" / "other" / "one.ipynb").write_text(SECRET)
    (root / "secret.json").write_text(json.dumps({"seed": SECRET}))
    book = sqlite3.connect(root / "gradebook.db")
    book.execute("create table grade (id, auto_score)")
    book.close()
    environment = {**os.environ, "SECRET": SECRET}
    victim = subprocess.Popen(["sleep", "900"], cwd=root, env=environment)
    server = socket.create_server(("127.0.0.1", 0))
    abstract = socket.socket(socket.AF_UNIX)
    called: list = []

    def listen(one):
        one.listen()
        while True:
            called.append(one.accept())

    port = server.getsockname()[1]
    abstract.bind(f"\0walls-{port}")
    for one in (server, abstract):
        threading.Thread(target=listen, args=[one], daemon=True).start()
    yield root, victim, port, called
    victim.kill()
    victim.wait()


def state(root):
    """All files that nobody may change."""
    places = [root, walls.PACKAGE / "course"]
    files = [p for place in places for p in place.rglob("*") if p.is_file()]
    return {p: hashlib.sha256(p.read_bytes()).hexdigest() for p in files if p.suffix != ".pyc"}


@pytest.fixture
def attacked(course):
    """Runs a source in a cell; whatever that does, nothing else has changed."""
    root, victim, port, called = course
    before = state(root)

    def run(source, seconds=20, walled=None):
        for name, value in {"COURSE": root, "PID": victim.pid, "PORT": port}.items():
            source = source.replace(name, str(value))
        with Walled() as own:
            one = walled or own
            one.begin(seconds)
            one.ask({"run": "from uavdh_lite.course import checks"})
            return one.ask({"run": source})

    yield run
    assert state(root) == before and victim.poll() is None and not called


@pytest.fixture(scope="module")
def walled(course):
    with Walled() as one:
        yield one


@pytest.mark.parametrize("kind", QUIET)
def test_an_attack_reaches_nothing(kind, attacked, walled):
    reply = attacked(QUIET[kind], walled=walled)
    said = json.dumps(reply)
    assert SECRET not in said and "SOLUTION" not in said and "np.log2" not in said
    assert "<script>" not in said  # of what is displayed, only text and PNG are kept


LOUD = {  # what takes all there is of something
    "ends itself": ("import os\nos._exit(0)", "it ended"),
    "a signal to itself": ("import os\nos.kill(os.getpid(), 9)", "it ended"),
    "forks": ("import os\nfor _ in range(10**6):\n    os.fork()", None),
    "threads": ("import threading, time\nwhile True:\n"
                "    threading.Thread(target=time.sleep, args=[99]).start()", None),
    "memory": ("x = bytearray(20 << 30)", None),
    "a file": ("open('x', 'wb').write(bytes(1 << 28))", None),
    "many files": ("for k in range(100):\n    open(f'x{k}', 'wb').write(bytes(1 << 23))", None),
    "output": ("while True:\n    print('x' * 100_000)", None),
    "output beside": ("import os\nwhile True:\n    os.write(2, b'x' * 100_000)", None),
    "an endless loop": ("while True:\n    pass", None),
    "what cannot be interrupted": ("import time\nwhile True:\n    try:\n        time.sleep(1)\n"
                                   "    except BaseException:\n        pass", "it never ends"),
    "a daemon": ("import os, time\nif not os.fork():\n    os.setsid()\n    time.sleep(99)", None),
    "a forged reply": ("import os\nfor fd in range(64):\n    try:\n"
                       "        os.write(fd, b'x' * 99)\n    except OSError:\n        pass",
                       "cannot be read"),
    "a long reply": ("import os\nfor fd in range(3, 64):\n    try:\n"
                     "        os.write(fd, bytes([0, 0, 9] + 5 * [0]))\n"
                     "    except OSError:\n        pass", "cannot be read"),
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("kind", LOUD)
def test_a_bomb_costs_nobody_else_anything(kind, attacked, monkeypatch):
    monkeypatch.setattr(walls, "GRACE", 2)
    source, reason = LOUD[kind]
    began = time.monotonic()
    if reason:
        with pytest.raises(Lost, match=reason):
            attacked(source, seconds=3 if reason == "it never ends" else 40)
    else:
        try:
            reply = attacked(source, seconds=3)
            assert len(json.dumps(reply)) < 300_000
        except Lost:
            pass
    assert time.monotonic() - began < 90
    left = [p.read_bytes() for p in Path("/proc").glob("[0-9]*/status") if p.exists()]
    assert not any(b"Name:\tsleep\n" in one and b"\t65534\t" in one for one in left)


PIPE = """
import gc
MORE = {{'fixed': 0, 'single': 0}}
held = [one for one in gc.get_objects() if type(one) is dict]
names = [one for one in held if {{'packed', 'sent'}} <= one.keys()]
pack, send = names[0]['packed'], names[0]['sent']
for one in names:
    one['{}'] = {}
def f(x): return 1
"""
PACKED = "lambda value: {} if value == 1 else pack(value)"
FORGED = {  # what a cell does so that a wrong answer counts
    "an answer equal to all": "class Yes(float):\n    __eq__ = lambda *_: True\n"
    "    __sub__ = __rsub__ = __abs__ = lambda *_: Yes(0)\ndef f(x): return Yes(1)",
    "an array of objects": "import numpy as np\ndef f(x): return np.array([Yes] * 3, object)",
    "a patched numpy": "import numpy as np\nnp.isclose = lambda *_, **k: np.array(True)\n"
    "def f(x): return 1.0",
    "a patched pipe": PIPE.format("packed", PACKED.format("{'class': 'os:system', 'fields': {}}")),
    "a dtype of its own": PIPE.format(
        "packed", PACKED.format("{'array': 'AAAA', 'dtype': 'O', 'shape': [1], **MORE}")
    ),
    "a shape too large": PIPE.format(
        "packed", PACKED.format("{'array': 'AAAA', 'dtype': 'u1', 'shape': [10**30], **MORE}")
    ),
    "a reply of its own": PIPE.format("sent", "lambda pipe, _: send(pipe, {'x': 1})"),
    "a reply that is none": PIPE.format("sent", "lambda pipe, _: send(pipe, [1])"),
    "an error for a value": "def f(x):\n    raise type('CheckFailed', (Exception,), {})('right')",
    "a changed argument": "def f(x):\n    x[...] = 0\n    return 1.0",
    "another name": "class F:\n    __module__ = 'uavdh_lite.course.checks.x'\n"
    "    __name__ = 5\n    __call__ = lambda self, x: 1\nf = F()",
    "a nested answer": "x = []\nfor _ in range(10**5):\n    x = [x]\ndef f(_): return x",
    "no answer": "f = None",
    "a class": "class f: pass",
    "what is not there": "",
    "an exit": "def f(x):\n    raise SystemExit",
}


@pytest.mark.parametrize("kind", FORGED)
def test_a_forged_answer_is_not_right(kind, attacked):
    with Walled() as walled:
        try:
            attacked(FORGED[kind], walled=walled)
            said, wrong = judged(walled, checks.EXERCISES["rate_from_snr"], "f", 20)
        except Lost:
            return
    assert wrong and "right." not in said


def test_what_is_printed_cannot_steer_a_terminal_and_the_first_process_knows_nothing(
    capsys, monkeypatch
):
    monkeypatch.setenv("SECRET", SECRET)
    with Walled() as walled:
        walled.begin(20)
        walled.ask({"run": "def f(x):\n    print('\\x1b[2Jgone\\u202e')"})
        walled.answer("f")(1)
        if walled.program == "bwrap":
            environment = Path(f"/proc/{walled.process.pid}/environ").read_bytes()
            assert b"PATH" in environment and SECRET.encode() not in environment
    assert capsys.readouterr().out == "�[2Jgone�\n"


def test_an_answer_is_judged_outside_and_its_line_is_told():
    one = checks.EXERCISES["rate_from_snr"]
    for source, right in (
        (RIGHT, "right."),
        ("def f(x):\n    print('hello')\n    return x / 0", "in line 3, `return x / 0`"),
        ("def f(x):\n    while True:\n        pass", "Is there a loop that never ends?"),
        ("def f(x):\n    x += 1\n    return x", "Work on a copy"),
    ):
        with Walled() as walled:
            walled.begin(20)
            walled.ask({"run": source})
            said, wrong = judged(walled, one, "f", 5)
        assert right in said + wrong and bool(wrong) == (source != RIGHT)


@pytest.mark.long
@pytest.mark.parametrize("script", sorted(SCRIPTS.glob("*.py")), ids=lambda script: script.stem)
def test_what_an_exercise_asks_and_gets_can_travel(script):
    """Each solution is right from outside, too: arguments go in, and what it gives comes out."""
    around, solved, handed = solutions(script)
    with Walled() as walled:
        walled.begin(60)
        walled.ask({"run": "\n".join([around, *solved.values()])})
        for name, answer in handed.items():
            if answer in solved:
                said, wrong = judged(walled, checks.EXERCISES[name], answer, 60)
                assert not wrong and said.endswith("right.\n")


def test_a_policy_reads_its_own_folder_and_no_other(tmp_path):
    secret = Challenge("village", 5, int(SECRET))
    secret.save(tmp_path / "secret.json")
    for name in ("alice", "bob"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "weights.txt").write_text("4")
    text = """
import os, pathlib
from uavdh_lite.planners import Greedy
own = pathlib.Path(__file__).parent
assert (own / "weights.txt").read_text() == "4" and os.listdir("/sheet") == ["alice"]
for path in FORBIDDEN:
    assert not os.path.exists(path), path
def policy(environment, state):
    return Greedy(environment).act(state)
"""
    forbidden = [str(tmp_path / name) for name in ("secret.json", "bob", "alice")]
    (tmp_path / "alice" / "policy.py").write_text(text.replace("FORBIDDEN", repr(forbidden)))
    assert score(secret, str(tmp_path / "alice"))["failed"] is None
    (tmp_path / "bob" / "policy.py").symlink_to(tmp_path / "alice" / "policy.py")
    with pytest.raises(InputError, match="is a link"):
        score(secret, str(tmp_path / "bob" / "policy.py"))


def test_without_walls_nothing_runs_unless_it_is_said(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    walls.program.cache_clear()
    with pytest.raises(InputError, match=r"bubblewrap.*docker.*grade book.*--unprotected"):
        Walled()
    walls.program.cache_clear()
    with Walled(unprotected=True) as walled:
        walled.begin(20)
        assert walled.ask({"run": "print(6 * 7)"})["said"] == "42"


def test_a_course_within_what_submissions_can_read_is_refused(monkeypatch):
    monkeypatch.chdir(walls.PACKAGE)
    walls.program.cache_clear()
    with pytest.raises(InputError, match="work in another folder"):
        Walled()
    walls.program.cache_clear()


def test_the_sheets_name_no_page_of_the_checks():
    for path in (NOTEBOOKS / "exercises").glob("*/*.ipynb"):
        sources = [cell.source for cell in nbformat.read(path, as_version=4).cells]
        assert not any(re.search(r"course\.checks\.|\.solution|EXERCISES", one) for one in sources)
