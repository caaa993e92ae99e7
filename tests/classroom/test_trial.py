"""Whatever is handed in ends in a sentence, soon, and the kernel lives."""

import builtins
import ctypes
import itertools
import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import torch

from uavdh_lite.course import checks
from uavdh_lite.course.checks import exercise as shared
from uavdh_lite.course.checks.trial import PRINTED, CheckFailed, within


def endless(*_):
    while True:
        pass


def catches_all(*_):
    while True:
        try:  # noqa: SIM105
            sum(range(100))
        except BaseException:  # as students write: except:
            pass


def sleeps(*_):
    time.sleep(4)


def leaves(*_):
    sys.exit(3)


def interrupts(*_):
    raise KeyboardInterrupt


def calls_itself(*_):
    return calls_itself()


def generates(*_):
    yield 1.0


class Nasty:
    """A value that refuses to be looked at."""

    def __repr__(self):
        raise RuntimeError("no repr")

    def __float__(self):
        raise RuntimeError("no float")

    __array__ = __bool__ = __len__ = __eq__ = __iter__ = __float__
    __hash__ = object.__hash__


class Rude(Exception):
    def __str__(self):
        raise RuntimeError("no text")


def raises_rudely(*_):
    raise Rude


recursive = [1.0]
recursive.append(recursive)

VALUES = [
    *(0, 1.5, True, "text", b"bytes", "", float("nan"), float("inf"), 10**400, 10**6000, 1j),
    *([], [[1.0, 2.0], [3.0]], (None, None), [None], {}, {1: 2}, set(), object(), Nasty(), int),
    *(np.zeros(0), np.array("text"), np.array([None, 1]), np.datetime64("2020-01-01"), np.nan),
    *(torch.tensor([1.0], requires_grad=True), torch.zeros(2, 0), itertools.count(), Rude()),
    *((i for i in range(3)), range(3), slice(3), print, NotImplemented, recursive, ("a", "b")),
    *((torch.zeros(2), [1, "x"]), [10**400, 10**400], ((1, 2), True), [torch.zeros(1)] * 2),
]
FUNCTIONS = [endless, catches_all, sleeps, leaves, interrupts, calls_itself, generates]
FUNCTIONS += [raises_rudely, builtins.print, builtins.len, np.sum, type, os.getcwd]


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(shared, "SECONDS", 2)
    for exercise in checks.EXERCISES.values():
        monkeypatch.setattr(exercise, "seconds", None)


def said_of(name, answer):
    with pytest.raises(CheckFailed) as caught:
        checks.EXERCISES[name](answer)
    text = str(caught.value)
    assert 10 < len(text) < 1500 and "cannot make sense" not in text, text
    return text


@pytest.mark.parametrize("name", checks.EXERCISES)
def test_whatever_is_handed_in_ends_in_a_sentence(name):
    for value in VALUES:
        said_of(name, value)
        said_of(name, (value, value))


@pytest.mark.parametrize("name", checks.EXERCISES)
def test_whatever_a_function_gives_back_ends_in_a_sentence(name):
    pairs = name in ("path_loss_crossover", "double_target")
    for value in VALUES:

        def answer(*_, value=value):
            return value

        said_of(name, (answer, answer) if pairs else answer)


@pytest.mark.parametrize("answer", FUNCTIONS)
def test_whatever_a_function_does_ends_in_a_sentence(answer, capsys):
    for name in ("rate_from_snr", "mean_rate"):
        begin = time.monotonic()
        text = said_of(name, answer)
        assert time.monotonic() - begin < 8
        if answer in (endless, catches_all, sleeps):
            assert "had not ended after 2 seconds" in text and answer.__name__ in text
        if answer is leaves:
            assert "stops with SystemExit: 3" in text
        if answer is generates:
            assert "is there a `yield`" in text or name != "rate_from_snr"


def test_an_endless_loop_is_stopped_and_not_only_left_alone():
    before = threading.active_count()
    for answer in (endless, catches_all):
        said_of("rate_from_snr", answer)
    assert threading.active_count() <= before


def test_nothing_is_said_of_an_error_that_python_ignores(capfd):
    class Lingers:
        def __del__(self):
            endless()

    def rate(snr_db):
        Lingers()
        endless()

    assert "had not ended" in said_of("rate_from_snr", rate)
    assert not capfd.readouterr().err


def test_work_within_its_time_raises_its_own_errors():
    with pytest.raises(ZeroDivisionError):
        within(5, lambda: 1 / 0)
    with pytest.raises(CheckFailed, match="The check had not ended"):
        within(0.2, lambda: time.sleep(1))


def test_an_interrupt_stops_the_answer_too(monkeypatch):
    before, join = threading.active_count(), threading.Thread.join

    def interrupted(self, timeout=None):
        if timeout == 0.1:
            raise KeyboardInterrupt
        join(self, timeout)

    monkeypatch.setattr(threading.Thread, "join", interrupted)
    with pytest.raises(KeyboardInterrupt):
        checks.rate_from_snr(endless)
    assert threading.active_count() <= before


def test_where_a_thread_cannot_be_stopped_the_message_comes_all_the_same(monkeypatch):
    monkeypatch.delattr(ctypes, "pythonapi")  # as in a Python that is not CPython
    end = threading.Event()
    with pytest.raises(CheckFailed, match=r"The check had not ended after 0\.2 seconds"):
        within(0.2, end.wait)
    end.set()


def test_without_threads_an_answer_is_checked_without_a_limit(monkeypatch):
    def refuse(self):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    done = []
    within(0.1, lambda: done.append(time.sleep(0.2)))
    assert done == [None]
    with pytest.raises(ZeroDivisionError):
        within(5, lambda: 1 / 0)
    assert "(0) gives 0" in said_of("rate_from_snr", lambda snr_db: 0.0 * snr_db)


@pytest.mark.parametrize("thread", ["main", "other"])
def test_a_plain_process_ends_after_an_endless_loop(thread):
    code = (
        "import threading\n"
        "from uavdh_lite.course import checks\n"
        "from uavdh_lite.course.checks import exercise\n"
        "exercise.SECONDS = 1\n"
        "def rate(snr_db):\n    while True: pass\n"
        "def main():\n"
        "    try: checks.rate_from_snr(rate)\n"
        "    except checks.CheckFailed as failed: print(failed)\n"
    )
    code += "main()" if thread == "main" else "threading.Thread(target=main).start()"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert "rate(0) had not ended after 1 seconds" in done.stdout and not done.stderr


def test_little_of_what_an_answer_prints_is_shown(capsys):
    def rate(snr_db):
        print("x" * 1500)
        return np.log2(1 + 10 ** (snr_db / 10))

    checks.rate_from_snr(rate)
    said = capsys.readouterr().out
    assert said.count("x") == PRINTED and said.endswith("Exercise 1.1: right.\n")
    assert "your function prints more" in said


def test_an_answer_with_a_memory():
    asked = []

    def rate(snr_db):
        asked.append(snr_db)
        return np.log2(1 + 10 ** (snr_db / 10)) + (len(asked) > 20)

    assert "asked again after other calls" in said_of("rate_from_snr", rate)


def test_a_warning_is_no_error(recwarn):
    def rate(snr_db):
        np.log(np.zeros(1))
        return np.log2(1 + 10 ** (snr_db / 10))

    checks.rate_from_snr(rate)
    assert not recwarn.list


def test_a_kernel_lives_on(tmp_path):
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    cells = [
        "from uavdh_lite.course import checks\n"
        "from uavdh_lite.course.checks import exercise\nexercise.SECONDS = 2",
        "def rate(snr_db):\n    while True:\n        print(snr_db)\nchecks.rate_from_snr(rate)",
        "def rate(snr_db):\n    exit()\nchecks.rate_from_snr(rate)",
        "def rate(snr_db):\n    raise KeyboardInterrupt\nchecks.rate_from_snr(rate)",
        "print('alive', type(exit).__name__)",
    ]
    notebook = nbformat.v4.new_notebook(cells=list(map(nbformat.v4.new_code_cell, cells)))
    nbclient.NotebookClient(notebook, timeout=60, allow_errors=True).execute(cwd=str(tmp_path))
    said = [
        "".join("\n".join(out.get("traceback", [])) + out.get("text", "") for out in cell.outputs)
        for cell in notebook.cells
    ]
    assert "rate(0) had not ended after 2 seconds" in said[1] and len(said[1]) < 3 * PRINTED
    assert "Not yet. rate(0) stops with SystemExit" in said[2] and "Traceback" not in said[2]
    assert "rate(0) stops with KeyboardInterrupt" in said[3]
    assert said[4].startswith("alive") and "function" not in said[4]
