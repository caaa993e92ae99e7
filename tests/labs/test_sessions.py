"""The labs' page: its sessions, without a browser."""

import datetime
from types import SimpleNamespace

from uavdh_lite.labs.app.server import LabsServer

LONG_AGO = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)


def test_a_session_that_waited_for_somebody_is_not_idle():
    """The search for idle sessions would end it in the moment before the page connects to it."""
    kernels = {
        name: SimpleNamespace(last_activity=LONG_AGO, trait_has_value=lambda trait: True)
        for name in ("waiting", "used")
    }
    kernels["starting"] = SimpleNamespace(trait_has_value=lambda trait: False)
    connections = {"waiting": 0, "used": 1}
    manager = SimpleNamespace(
        list_kernel_ids=lambda: list(kernels),
        kernel_model=lambda name: {"connections": connections[name]},
        get_kernel=kernels.get,
    )
    LabsServer.wake(SimpleNamespace(kernel_manager=manager))
    now = datetime.datetime.now(datetime.UTC)
    assert now - kernels["waiting"].last_activity < datetime.timedelta(minutes=1)
    assert kernels["used"].last_activity == LONG_AGO
