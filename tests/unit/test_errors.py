import sys

import pytest

from uavdh_lite.errors import InputError, MissingExtra, extra
from uavdh_lite.experiments.study import run_study


def test_a_missing_package_is_one_line_with_the_command_that_installs_it(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtra) as caught:
        run_study(None, {}, 1, tmp_path, scheduler="tcp://nowhere:1")
    assert str(caught.value) == "distributed is not installed: pip install 'uavdh-lite[dask]'"
    assert isinstance(caught.value, InputError) and isinstance(caught.value, ImportError)


def test_a_module_of_ours_that_is_missing_is_a_fault():
    with pytest.raises(ModuleNotFoundError) as caught, extra("app"):
        import uavdh_lite.nothing_like_it  # noqa: F401
    assert not isinstance(caught.value, MissingExtra)
