"""A place in a scene of Sionna RT becomes a city and a table of gains."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from uavdh_lite.beyond.measured import load_gains, load_place
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError

pytestmark = pytest.mark.long  # Sionna RT takes seconds to begin


@pytest.fixture(scope="module")
def trace():
    """The program; without Sionna RT, or a processor for it to trace on, tests are skipped."""
    for library in Path("/usr/lib").glob("*/libLLVM*.so*"):
        if library.name in ("libLLVM-19.so", "libLLVM.so.19.1"):
            os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(library))
    try:
        from benchmarks import trace
    except ImportError as error:
        pytest.skip(str(error))
    return trace


@pytest.fixture(scope="module")
def canyon(trace):
    return trace.Place("simple_street_canyon", (0.0, 0.0), size=8, rays=20_000)


def test_gains_fall_as_in_free_space_along_a_street_between_tall_buildings(trace, canyon):
    tracer = trace.Tracer(canyon)
    city = tracer.city("canyon", landing=2)
    assert not city.buildings[3:5].any()  # the street runs from west to east
    assert city.no_fly[0].sum() >= 4 and (city.buildings == city.no_fly).all()
    assert city.landing.sum() == 2 and city.landing[3:5].sum() == 2
    gain_db = tracer.gains(city)
    assert (gain_db[~city.open_to_devices.ravel()] == -np.inf).all()
    device = 3 * 8  # the west end of the street
    along = gain_db[device, device : device + 8]
    distance_m = np.hypot(10 * np.arange(8), canyon.altitude_m - canyon.device_height_m)
    free_space_db = 20 * np.log10(3e8 / canyon.frequency_hz / (4 * np.pi * distance_m))
    assert (along[2:] > free_space_db[2:] - 2).all()  # walls and ground add to it
    assert (along[2:] < free_space_db[2:] + 6).all()
    behind = ~Environment(city).sight[0, device] & ~city.no_fly.ravel()
    assert gain_db[device, behind].max() < along.max()


@pytest.mark.parametrize(
    ("place", "named"),
    [
        ({"centre": (5000.0, 0.0)}, "beyond the scene's ground"),
        ({"scene": __file__}, "test_trace.py: no scene that can be traced"),
        ({"scene": "san_francisco", "centre": (-400.0, 300.0)}, "rises by"),
    ],
)
def test_a_place_that_cannot_be_traced_is_named(trace, canyon, place, named):
    with pytest.raises(InputError, match=named):
        trace.Tracer(replace(canyon, **place))


def test_the_command_writes_a_city_and_its_gains(trace, tmp_path, capsys):
    out = tmp_path / "canyon.png"
    options = ["--cells", "4", "--rays", "1000", "--landing-cells", "1", "--out", str(out)]
    trace.main(["simple_street_canyon", "--centre=-5,0", *options])
    gain_db, about = load_gains(tmp_path / "canyon.npz")
    assert gain_db.shape == (16, 16) and about["centre"] == [-5, 0]
    assert "L" in capsys.readouterr().out and load_place(out).size == 4
    for scene, to, said in (
        ("simple_street_canyon", out, "canyon.npz exists"),
        ("nowhere.xml", tmp_path / "b.png", "nowhere.xml: no scene that can be traced"),
    ):
        with pytest.raises(SystemExit):
            trace.main([scene, "--centre=25,10", *options, f"--out={to}"])
        assert said in capsys.readouterr().err
