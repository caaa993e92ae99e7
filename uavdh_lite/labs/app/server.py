"""A Voilà server of the labs: for this machine only; sessions that nobody uses end."""

import os
import shutil
import signal
import sys
import tempfile
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from uavdh_lite.errors import extra

with extra("app"):
    import psutil
    import tornado.web
    from tornado.ioloop import IOLoop
    from voila.app import Voila
    from voila.tornado.handler import TornadoVoilaHandler

FOLDER = Path(__file__).parent
# Other installed extensions, of JupyterLab or Notebook, may need a newer JupyterLab than Voilà's
EXTENSIONS = [
    "@voila-dashboards/widgets-manager8",
    "@jupyter-widgets/jupyterlab-manager",
    "anywidget",
]
CULL_EVERY = 15  # seconds between searches for idle sessions
LONGEST_FOLDER = 38  # characters; the name of a socket in it has 65 more, and may have 103
WEBSOCKET_BYTES = 16_000_000  # a longer message, such as a huge upload, is cut off


class LabsHandler(TornadoVoilaHandler):
    """The page, with a session of its own."""

    async def get(self, path=None):
        server = self.settings["voila"]
        if path:
            raise tornado.web.HTTPError(404)
        server.wake()
        _ = self.xsrf_token  # sets the cookie that the page needs to end its session
        await super().get(path)


class LabsServer(Voila):
    """Voilà; each session is a kernel, and one more is kept ready."""

    def wake(self) -> None:
        """Let the sessions that wait for somebody count as just used: else a new one ends soon."""
        for kernel_id in self.kernel_manager.list_kernel_ids():
            kernel = self.kernel_manager.get_kernel(kernel_id)
            started = kernel.trait_has_value("last_activity")  # else it is not idle yet
            if started and not self.kernel_manager.kernel_model(kernel_id)["connections"]:
                kernel.last_activity = datetime.now(UTC)

    def init_handlers(self) -> list:
        *others, (pattern, _, options) = super().init_handlers()
        return [*others, (pattern, LabsHandler, options)]

    def initialize(self, argv=None) -> None:
        super().initialize(argv)
        # After Voilà's own handler, and also where the parent process ignores SIGINT
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._end)

    def _end(self, number, frame) -> None:
        """Leave the loop; once is enough."""
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, signal.SIG_IGN)
        loop = IOLoop.current()
        loop.add_callback_from_signal(loop.stop)

    def stop(self) -> None:
        """End the sessions at once, those that are only starting too: none has anything to save.

        Voilà's own way asks each kernel and waits, and fails for one that is not ready yet.
        """
        for process in psutil.Process().children():
            with suppress(psutil.NoSuchProcess):
                if "ipykernel_launcher" in process.cmdline():
                    process.kill()
                    process.wait()
        shutil.rmtree(self.connection_dir, ignore_errors=True)


def serve(port: int, idle_seconds: int, open_browser: bool) -> None:
    """Serve the labs on 127.0.0.1 until SIGINT (Ctrl-C) or SIGTERM.

    Arguments:
        port: the port; the next free one if it is taken.
        idle_seconds: end a session that nobody has used for this long.
        open_browser: open the page in this machine's browser.
    """
    # Voilà looks for templates in Jupyter's folders. One thread for each session: they share cores
    paths = [str(FOLDER), os.environ.get("JUPYTER_PATH", "")]
    os.environ["JUPYTER_PATH"] = os.pathsep.join(filter(None, paths))
    os.environ["OMP_NUM_THREADS"] = "1"
    server = LabsServer.instance(
        ip="127.0.0.1",
        port=port,
        notebook_path=str(FOLDER / "labs.ipynb"),
        open_browser=open_browser,
        config_file_paths=[],
        log_level="ERROR",
        tornado_settings={
            "allow_remote_access": False,
            "websocket_max_message_size": WEBSOCKET_BYTES,
            "ws_ping_interval": 0,  # no pings: a page that answers late would lose its session
        },
    )
    server.config.VoilaConfiguration.update(
        template="uavdh_lite",
        preheat_kernel=True,
        default_pool_size=1,
        allow_template_override="NO",
        allow_theme_override="NO",
        file_allowlist=[],
        extension_allowlist=EXTENSIONS,
    )
    server.config.MappingKernelManager.update(
        cull_idle_timeout=idle_seconds,
        cull_interval=min(CULL_EVERY, idle_seconds),
        cull_connected=True,
    )
    if os.name == "posix" and len(tempfile.gettempdir()) <= LONGEST_FOLDER:
        server.config.KernelManager.transport = "ipc"  # files only this user can open, no ports
    server.initialize([])
    IOLoop.current().add_callback(
        lambda: print(f"labs: {server.connection_url} (Ctrl-C ends it)", file=sys.stderr)
    )
    server.start()
