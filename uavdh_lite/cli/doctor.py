"""`doctor`: what is installed, what is missing, and how to get it."""

import re
import time
import webbrowser
from importlib import metadata

from uavdh_lite.provenance import provenance

EXTRAS = {
    "notebooks": "the course in JupyterLab",
    "classroom": "grading a class",
    "gym": "Gymnasium",
    "onnx": "export",
    "tensorboard": "TensorBoard",
    "docs": "the site",
}


def doctor() -> None:
    """Say what is installed, what is missing and how to get it, then fly for a second."""
    for name, value in provenance().items():
        print(f"{name:<12} {value}")
    try:
        needed = metadata.requires("uavdh-lite") or []
    except metadata.PackageNotFoundError:
        needed = []
        print(f"{'package':<12} runs from its folder, not installed: pip install .")
    for extra, use in EXTRAS.items():
        own = [
            re.split(r"[^\w.-]", one)[0] for one in needed if re.search(f"extra == .{extra}", one)
        ]
        missing = [package for package in own if not _is_installed(package)]
        said = (
            f"missing {', '.join(missing)}: pip install 'uavdh-lite[{extra}]'" if missing else "ok"
        )
        if own:
            print(f"{extra:<12} {use}: {said}")
    try:
        print(f"{'browser':<12} {webbrowser.get().__class__.__name__}: ok")
    except webbrowser.Error:
        print(f"{'browser':<12} none is found: open the address that the labs print by yourself")
    print(f"{'flying':<12} {_flown()}")


def _is_installed(package: str) -> bool:
    try:
        return bool(metadata.version(package))
    except metadata.PackageNotFoundError:
        return False


def _flown() -> str:
    """A shipped agent flies for a second."""
    from uavdh_lite.checkpoint import load_agent
    from uavdh_lite.evaluation import evaluate

    agent, missions, landed, started = load_agent("manhattan"), 0, 0.0, time.monotonic()
    while (seconds := time.monotonic() - started) < 1:
        flights = evaluate(agent.environment, agent, agent.scenario, 20, seed=missions)
        missions, landed = missions + 20, landed + float(flights.end.landed.sum())
    return f"{missions} missions in {seconds:.1f} s, {landed / missions:.0%} landed: ok"
