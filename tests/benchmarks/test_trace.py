"""A place in a scene of Sionna RT becomes a city and a table of gains."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import trace
from benchmarks.trace import Place, Tracer
from uavdh_lite.beyond.measured import MeasuredEnvironment, load_gains, load_place
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


MESHLESS = """<scene version="2.1.0"><shape type="ply" id="mesh-a">
<string name="filename" value="nowhere.ply"/></shape></scene>"""


@pytest.mark.parametrize(
    ("place", "named"),
    [
        ({"scene": "atlantis"}, "atlantis: neither"),
        ({"scene": "meshless.xml"}, r"meshless\.xml: cannot be loaded"),
        ({"scene": "broken.xml"}, r"broken\.xml: cannot be loaded"),
        ({"centre": (5000.0, 0.0)}, "beyond the scene's ground"),
        ({"scene": "san_francisco", "centre": (-400.0, 300.0)}, "rises by"),
    ],
)
def test_a_place_that_cannot_be_traced_is_named_in_a_line(
    tracer, place, named, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    Path("meshless.xml").write_text(MESHLESS)
    Path("broken.xml").write_text("<scene><shape")
    with pytest.raises(InputError, match=named) as error:
        Tracer(replace(CANYON, **place))
    assert "\n" not in str(error.value)


def test_the_command_writes_a_city_and_its_gains_and_keeps_another_city(tracer, tmp_path, capsys):
    out = tmp_path / "canyon.png"
    options = ["--cells", "4", "--rays", "1000", "--landing-cells", "1", "--out", str(out)]
    trace.main(["simple_street_canyon", "--centre=-5,0", *options])
    gain_db, about = load_gains(tmp_path / "canyon.npz")
    assert gain_db.shape == (16, 16) and about["centre"] == [-5, 0]
    assert "L" in capsys.readouterr().out and load_place(out).size == 4
    with pytest.raises(SystemExit, match=r"canyon\.png: holds another city"):
        trace.main(["simple_street_canyon", "--centre=25,10", *options])


@pytest.mark.parametrize("llvm", [None, 16])
def test_without_a_processor_to_trace_on_the_error_says_what_is_missing(tracer, monkeypatch, llvm):
    """As Sionna RT fails without LLVM and without a GPU; an old LLVM would end the process."""
    import drjit

    def found():
        if llvm is None:
            raise ImportError("the LLVM backend is inactive")
        return llvm, 0, 6

    monkeypatch.setattr(drjit.detail, "llvm_version", found)
    monkeypatch.setattr("mitsuba.variant", lambda: "llvm_ad_mono_polarized")
    with pytest.raises(InputError, match=r"\((found LLVM 16|.*inactive)\).*DRJIT_LIBLLVM_PATH"):
        trace._sionna()
