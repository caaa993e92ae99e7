import sys

import pytest

from uavdh_lite.errors import InputError, MissingExtra, extra


def test_a_missing_package_is_one_line_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(MissingExtra) as caught, extra("onnx"):
        import onnx  # noqa: F401
    assert str(caught.value) == "onnx is not installed: pip install 'uavdh-lite[onnx]'"
    assert isinstance(caught.value, InputError) and isinstance(caught.value, ImportError)
