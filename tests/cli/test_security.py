"""Nothing unpickles or evaluates what it reads, and nothing listens for connections."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "shelve", "marshal"}
CALLS = {"eval", "exec", "compile"}
OWN = {"uavdh_lite/course/exam.py": ["eval"]}  # of formulas that lie in the package
LOADERS = {"torch.load", "joblib.load", "yaml.load", "np.load"}


def forbidden_in(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from {alias.name.split(".")[0] for alias in node.names} & MODULES
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from {node.module.split(".")[0]} & MODULES
        elif isinstance(node, ast.Call):
            arguments = {ast.unparse(keyword) for keyword in node.keywords}
            if "allow_pickle=False" not in arguments:
                yield from {ast.unparse(node.func)} & (CALLS | LOADERS)


@pytest.mark.parametrize("folder", ["uavdh_lite", "notebooks", "benchmarks"])
def test_no_pickle_and_no_evaluation(folder):
    pattern = "**/*.py" if folder == "uavdh_lite" else "*.py"
    found = {
        str(path.relative_to(ROOT)): list(forbidden_in(ast.parse(path.read_text())))
        for path in (ROOT / folder).glob(pattern)
    }
    assert {name: calls for name, calls in found.items() if calls} == (
        OWN if folder == "uavdh_lite" else {}
    )
    assert found


@pytest.mark.parametrize("module", ["http.server", "socketserver", "tornado"])
def test_nothing_serves(module):
    sources = (path.read_text() for path in (ROOT / "uavdh_lite").rglob("*.py"))
    assert not any(re.search(rf"^\s*(import|from) {module}", text, re.M) for text in sources)
