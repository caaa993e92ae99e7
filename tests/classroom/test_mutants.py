"""Each solution with one small fault in it is refused, with a rule or a mistake named."""

import warnings

import numpy as np
import pytest
import torch
from mutants import SCRIPTS, mutants, solutions, solved_in

from uavdh_lite.course import checks
from uavdh_lite.course.checks import exercise as shared
from uavdh_lite.course.checks.channel import SAME_LOSS
from uavdh_lite.course.checks.ddqn import TARGET

# Not mutated: `policy` may be any rule that is good enough, and values are no functions
MUTATED = [
    (script, name)
    for script in sorted(SCRIPTS.glob("*.py"))
    for name in solved_in(script)
    if name != "policy"
]

EQUIVALENT = {  # by exercise: which faults change no result, and why
    "mean_rate": {"rate(snr_db - fading_db)": "the fading is symmetric"},
    "crosses": {"abs(cols * r - rows * c)": "the absolute value is the same"},
    "shadow_map": {"for side in (1, -1):": "the order of the sides makes no difference"},
    "tdma_slot": {
        "device = np.where(data_left > 0, snr_db, -np.inf).argmax()": "numpy's integer is as good",
    },
    "reward": {"- intervened -": "1.0 times it is the same"},
    "soft_update_in_place": {
        "zip(target, online):": "the lists are equally long",
        "strict=False": "the lists are equally long",
    },
    "steps_to": {"reached = step": "numpy's integer is as good as Python's"},
    "permutation_p": {
        "return np.mean(as_large)": "numpy's float is as good as Python's",
        "np.mean(b) - np.mean(a)": "the absolute value is the same",
        "values[~first].mean() - values[first]": "the absolute value is the same",
        "difference > observed - 1e-09": "no difference is off by exactly 1e-9",
    },
    "reachable": {
        "(row, int(col)) for": "numpy's integers are as good as Python's",
        "(int(row), col) for": "numpy's integers are as good as Python's",
    },
    "worst_device_cell": {
        "divmod(number, city.size)": "numpy's integer is as good as Python's",
        "environment.sight[-1]": "there is one city",
    },
    "flight_score": {"return -1e-09": "within the tolerance of rounding"},
    "quantile_loss": {
        "np.abs(u) < kappa": "where |u| is κ both lines agree",
        "(u < 0) - levels": "the absolute value is the same",
        "(u <= 0)": "an error of 0 costs nothing",
    },
    "longest_way": {"way = -1": "a way of 0 always pays"},
    "clustered_half_width": {
        "values.mean() - values": "the squares are the same",
        "city != one": "all differences add up to 0, so the others' sum has the same square",
    },
    "n_step_return": {"(-1e-09, 1.0)": "within the tolerance of rounding"},
}


SLOW = ("crosses", "reachable", "safe_step", "shadow_map")  # 100 s of 140 s on one busy core


@pytest.mark.long
@pytest.mark.parametrize(
    "script, name",
    [
        pytest.param(*key, id=key[1], marks=[pytest.mark.longest] if key[1] in SLOW else [])
        for key in MUTATED
    ],
)
def test_mutants_of_a_solution_are_refused_with_a_reason(script, name, monkeypatch, capsys):
    around, solved, handed = solutions(script)
    space = {"__name__": "answers"}
    exec(around, space)
    exec("\n".join(solved.values()), space)
    checks.EXERCISES[name](eval(handed[name], space))
    passed, untold = [], []
    for mutant in mutants(script, name):
        exec("\n".join([*solved.values(), mutant.source]), space)
        equivalent = any(part in mutant.key.split(" -> ")[1] for part in EQUIVALENT.get(name, ()))
        monkeypatch.setattr(shared, "SECONDS", 60 if equivalent else 0.4)  # some never end
        try:
            with warnings.catch_warnings():
                checks.EXERCISES[name](eval(handed[name], space))
        except checks.CheckFailed as failed:
            assert not equivalent, mutant.key
            text = str(failed)
            assert "cannot make sense" not in text, text
            if text.rstrip(".").endswith("expected") or len(text) < 15:
                untold.append(mutant.key)
        else:
            if not equivalent:
                passed.append(mutant.key)
    assert not passed and not untold


TABLES = {name: one.table for name, one in checks.EXERCISES.items() if one.table}
TABLES |= {"path_loss_crossover": SAME_LOSS, "double_target": TARGET}


def refused(table, answer):
    with pytest.raises(checks.CheckFailed) as caught, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        table(answer)
    return str(caught.value)


@pytest.mark.parametrize("name", TABLES)
def test_every_parameter_matters_and_no_result_may_be_rounded(name):
    table = TABLES[name]
    first = table.cases[0][1]
    for k in range(2 if name == "mean_rate" else len(first)):  # no single result shows its draws
        refused(table, lambda *case, k=k: table.solution(*case[:k], first[k], *case[k + 1 :]))
    if all(right.value.dtype.kind == "f" for right in table.right):
        whole = all((right.value == np.rint(right.value)).all() for right in table.right)

        def changed(change):
            def answer(*case):
                result = table.solution(*case)
                if isinstance(result, torch.Tensor):
                    return change(result)
                return change(np.asarray(result, float))

            return answer

        refused(table, changed(lambda result: result * 0))
        if not whole:
            refused(table, changed(lambda result: result.round(decimals=2)))


@pytest.mark.parametrize("name", TABLES)
def test_each_named_mistake_is_recognised_as_itself(name):
    table = TABLES[name]
    for message, mistake in table.each_mistake:
        assert refused(table, mistake) == message
