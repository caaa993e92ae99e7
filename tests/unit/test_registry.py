from types import SimpleNamespace

import pytest

from uavdh_lite import registry
from uavdh_lite.errors import InputError


def test_an_extension_is_loaded_when_a_name_is_looked_up(monkeypatch):
    extension = SimpleNamespace(load=lambda: registry.register("recipe", "mine", 42))
    monkeypatch.setattr(registry, "_known", {})
    monkeypatch.setattr(registry, "entry_points", lambda group: [extension])
    monkeypatch.setattr(registry, "_load_extensions", registry._load_extensions.__wrapped__)
    assert registry.find("recipe", "mine") == 42
    assert registry.names("recipe") == ["mine"] and registry.names("scenario") == []
    with pytest.raises(InputError, match=r"recipe 'yours'.*mine"):
        registry.find("recipe", "yours")


def test_what_is_beyond_the_paper_is_known_by_name():
    assert {"paper", "lite", "small", "told", "imitation"} <= set(registry.names("recipe"))
