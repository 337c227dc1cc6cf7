"""The live view's server process: meshcat's own server, reachable from this machine only.

Run as ``python -m leg_dynamics.preview.server``; it prints its two addresses and ends when its standard input does,
so that it cannot outlive the process that started it.
"""

from __future__ import annotations

import functools
import sys
import threading
from importlib import resources

import tornado.web
from meshcat.servers.zmqserver import ZMQWebSocketBridge

__all__ = ["LoopbackBridge", "main"]


class ViewerPage(tornado.web.RequestHandler):
    """meshcat's viewer page with our legend."""

    def get(self) -> None:
        """Send the page."""
        folder = resources.files("leg_dynamics.preview")
        page, legend = (folder.joinpath(name).read_text(encoding="utf-8") for name in ("live.html", "legend.js"))
        self.set_header("Cache-Control", "no-store")
        self.finish(page.replace("@legend@", legend))


class LoopbackBridge(ZMQWebSocketBridge):
    """meshcat's bridge, whose web server otherwise listens on every network interface."""

    def make_app(self) -> tornado.web.Application:
        """The web application, bound to the same host as the command socket."""
        application = super().make_app()
        application.add_handlers(r".*", [(r"/static/(?:index\.html)?", ViewerPage)])
        application.listen = functools.partial(application.listen, address=self.host)
        return application


def main() -> None:
    """Serve until standard input closes."""
    bridge = LoopbackBridge(host="127.0.0.1")
    print(f"zmq_url={bridge.zmq_url}", flush=True)
    print(f"web_url={bridge.web_url}", flush=True)

    def stop_with_parent() -> None:
        sys.stdin.read()
        bridge.ioloop.add_callback(bridge.ioloop.stop)

    threading.Thread(target=stop_with_parent, daemon=True).start()
    bridge.run()


if __name__ == "__main__":
    main()
