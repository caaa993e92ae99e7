"""Each solution with one small fault in it is refused."""

import signal
import sys
import time
import warnings

import pytest
from mutants import SCRIPTS, mutants, solutions, solved_in

from uavdh_lite.course import checks

MUTATED = [(script, name) for script in sorted(SCRIPTS.glob("*.py")) for name in solved_in(script)]
EQUIVALENT = {  # by exercise: which faults change no result, and why
    "mean_rate": {"rate(snr_db - fading_db)": "the fading is symmetric"},
    "crosses": {"abs(cols * r - rows * c)": "the absolute value is the same"},
    "tdma_slot": {
        "device = np.where(data_left > 0, snr_db, -np.inf).argmax()": "numpy's integer is as good",
    },
    "steps_to": {"reached = step": "numpy's integer is as good as Python's"},
    "mended_update": {"((q - y) ** 2)": "the squares are the same"},
    "by_surprise": {"2 / np.arange(1": "what is divided by its sum does not change"},
    "permutation_p": {
        "return np.mean(as_large)": "numpy's float is as good as Python's",
        "np.mean(b) - np.mean(a)": "the absolute value is the same",
        "values[~first].mean() - values[first]": "the absolute value is the same",
        "difference > observed - 1e-09": "no difference is off by exactly 1e-9",
    },
    "clustered_half_width": {
        "values.mean() - values": "the squares are the same",
        "city != one": "all differences add up to 0, so the others' sum has the same square",
    },
    "missions_needed": {"low_end(n) <= share": "no low end is a share of the cases"},
    "shadow_reach": {
        "<= 1 / np.e": "no correlation of the cases is 1/e",
        "left_db.mean() - left_db": "the sign falls out of the products",
    },
}
SLOW = ("crosses", "safe_step", "permutation_p", "missions_needed", "mended_update")


def refused(name, answer, seconds):
    """What is said of an answer; one that does not end is interrupted, as in a notebook.

    After some seconds of this process alone, because others may take its core.
    """

    def interrupt(*_):
        raise KeyboardInterrupt

    signal.signal(signal.SIGVTALRM, interrupt)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return checks.EXERCISES[name].wrong_with(answer)
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="there is no alarm to interrupt loops with")
@pytest.mark.parametrize(
    "script, name",
    [
        pytest.param(*key, id=key[1], marks=[pytest.mark.longest] if key[1] in SLOW else [])
        for key in MUTATED
    ],
)
def test_mutants_of_a_solution_are_refused(script, name, capsys):
    around, solved, handed = solutions(script)
    space = {"__name__": "answers"}
    exec("\n".join([around, *solved.values()]), space)
    began = time.process_time()
    assert not refused(name, eval(handed[name], space), 60)
    most = 0.1 + 3 * (time.process_time() - began)  # seconds; what never ends takes longer
    passed = []
    for fault, source in mutants(script, name):
        exec("\n".join([*solved.values(), source]), space)
        equivalent = any(part in fault.split(" -> ")[1] for part in EQUIVALENT.get(name, ()))
        said = refused(name, eval(handed[name], space), 60 if equivalent else most)
        assert not (equivalent and said), fault
        if not (equivalent or said):
            passed.append(fault)
    assert not passed
