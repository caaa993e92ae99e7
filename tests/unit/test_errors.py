import importlib
import sys

import pytest

from uavdh_lite.errors import InputError, MissingExtra, extra
from uavdh_lite.experiments.ablation import run_study
from uavdh_lite.experiments.runs import train
from uavdh_lite.experiments.tensorboard import Board


def test_a_missing_package_is_one_line_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(MissingExtra) as caught, extra("onnx"):
        import onnx.helper  # noqa: F401
    assert str(caught.value) == "onnx is not installed: pip install 'uavdh-lite[onnx]'"
    assert isinstance(caught.value, InputError) and isinstance(caught.value, ImportError)


def test_a_module_of_ours_that_is_missing_is_a_fault():
    with pytest.raises(ModuleNotFoundError) as caught, extra("app"):
        import uavdh_lite.nothing_like_it  # noqa: F401
    assert not isinstance(caught.value, MissingExtra)


def test_what_is_installed_is_imported():
    with extra("app"):
        import json.tool
    assert json.tool


def test_gymnasium_tensorboard_and_dask_are_asked_for(monkeypatch, tmp_path):
    for package in ("gymnasium", "tensorboard", "distributed"):
        monkeypatch.setitem(sys.modules, package, None)
    for name in ("uavdh_lite.gym", "torch.utils.tensorboard"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    with pytest.raises(MissingExtra, match=r"gymnasium is .*'uavdh-lite\[gym\]'"):
        importlib.import_module("uavdh_lite.gym")
    with pytest.raises(MissingExtra, match=r"tensorboard is .*'uavdh-lite\[tensorboard\]'"):
        Board(tmp_path, None)
    with pytest.raises(MissingExtra, match="tensorboard"):
        train(None, tmp_path / "run", tensorboard=True)
    assert not (tmp_path / "run").exists()  # a refused run leaves nothing behind
    with pytest.raises(MissingExtra, match=r"distributed is .*'uavdh-lite\[dask\]'"):
        run_study(None, {}, 1, tmp_path, backend="dask")
