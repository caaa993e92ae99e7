"""A place in a scene of Sionna RT becomes a city and a table of gains."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from uavdh_lite.beyond.measured import MeasuredEnvironment, load_gains, modelled_snr_db
from uavdh_lite.bridges import sionna
from uavdh_lite.bridges.sionna import Place, Tracer
from uavdh_lite.cli.main import main
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError

CANYON = Place("simple_street_canyon", (0.0, 0.0), size=8, rays=20_000)


@pytest.fixture(scope="module")
def tracer():
    pytest.importorskip("sionna.rt")
    for library in Path("/usr/lib").glob("*/libLLVM*.so*"):
        if library.name in ("libLLVM-19.so", "libLLVM.so.19.1"):
            os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(library))
    try:
        return Tracer(CANYON)
    except InputError as error:
        pytest.skip(str(error))


def test_the_canyon_is_a_street_between_tall_buildings(tracer):
    city = tracer.city("canyon", landing=2)
    free = ~city.buildings
    assert free[3:5].all()  # the street runs from west to east
    assert city.no_fly[0].sum() >= 4 and (city.buildings == city.no_fly).all()
    assert city.landing.sum() == 2 and city.landing[3:5].sum() == 2


def test_gains_fall_as_in_free_space_along_the_street_and_are_written(tracer, tmp_path):
    city, path = tracer.city("canyon", landing=2), tmp_path / "canyon.npz"
    gain_db = tracer.trace(city, path)
    found, about = load_gains(path)
    assert np.array_equal(found, gain_db) and about["rays"] == 20_000
    assert (gain_db[~city.open_to_devices.ravel()] == -np.inf).all()
    environment = Environment(city)
    device = 3 * 8  # the west end of the street
    along = gain_db[device, device : device + 8]
    distance_m = np.hypot(10 * np.arange(8), CANYON.altitude_m - CANYON.device_height_m)
    free_space_db = 20 * np.log10(3e8 / CANYON.frequency_hz / (4 * np.pi * distance_m))
    assert (along[2:] > free_space_db[2:] - 2).all()  # walls and ground add to it
    assert (along[2:] < free_space_db[2:] + 6).all()
    behind = ~environment.sight[0, device] & ~city.no_fly.ravel()
    assert gain_db[device, behind].max() < along.max()
    world = MeasuredEnvironment(city, mean_snr_db=gain_db + 70)
    assert world.rate_map(device).shape == (8, 8)
    assert modelled_snr_db(environment).shape == gain_db.shape


def test_a_trace_that_was_stopped_goes_on_and_another_one_is_refused(tracer, tmp_path, monkeypatch):
    city, path = tracer.city("canyon", landing=2), tmp_path / "canyon.npz"
    traced = []

    def stopped(self, cell):
        if len(traced) == 3:
            raise KeyboardInterrupt
        traced.append(cell)
        return np.full(64, -80.2)

    monkeypatch.setattr(Tracer, "_gains_from", stopped)
    with pytest.raises(KeyboardInterrupt):
        tracer.trace(city, path)
    unfinished, _ = load_gains(path)
    assert np.isnan(unfinished).any()
    with pytest.raises(InputError, match="NaN"):
        MeasuredEnvironment(city, mean_snr_db=unfinished)
    monkeypatch.setattr(Tracer, "_gains_from", lambda self, cell: np.full(64, -90.0))
    gain_db = tracer.trace(city, path)
    assert (gain_db[traced] == -80).all()  # steps of half a decibel
    others = np.setdiff1d(np.flatnonzero(city.open_to_devices), traced)
    assert (gain_db[others] == -90).all()
    other = Tracer(replace(CANYON, rays=10_000))
    with pytest.raises(InputError, match=r"canyon\.npz: holds another trace"):
        other.trace(city, path)


@pytest.mark.parametrize(
    ("place", "named"),
    [
        (Place("atlantis"), "atlantis: neither"),
        (replace(CANYON, centre=(5000.0, 0.0)), "beyond the scene's ground"),
        (Place("san_francisco", (-400.0, 300.0), size=8), "rises by"),
    ],
)
def test_a_place_that_cannot_be_traced_is_named(tracer, place, named):
    with pytest.raises(InputError, match=named):
        Tracer(place)


def test_the_command_writes_a_city_and_its_gains(tracer, tmp_path, capsys):
    out = tmp_path / "canyon.png"
    options = ["--cells", "4", "--rays", "1000", "--landing-cells", "1", "--out", str(out)]
    assert main(["trace", "simple_street_canyon", "--centre", "-5,0", *options]) == 0
    gain_db, about = load_gains(tmp_path / "canyon.npz")
    assert gain_db.shape == (16, 16) and about["centre"] == [-5, 0]
    assert "4 × 4 cells" in capsys.readouterr().out


def test_without_a_processor_to_trace_on_the_error_says_what_is_missing(monkeypatch):
    """As Sionna RT fails without LLVM and without a GPU."""
    real = __import__

    def failing(name, *rest, **more):
        if name == "sionna":
            raise ImportError("the LLVM backend is inactive")
        return real(name, *rest, **more)

    pytest.importorskip("mitsuba")
    monkeypatch.setattr("builtins.__import__", failing)
    with pytest.raises(InputError, match="DRJIT_LIBLLVM_PATH"):
        sionna._sionna()


def test_an_llvm_that_would_end_the_process_is_refused(tracer, monkeypatch):
    import drjit

    monkeypatch.setattr(drjit.detail, "llvm_version", lambda: (16, 0, 6))
    monkeypatch.setattr("mitsuba.variant", lambda: "llvm_ad_mono_polarized")
    with pytest.raises(InputError, match=r"\(found LLVM 16\); on a CPU it needs LLVM 17"):
        Tracer(CANYON)
