"""A page that shows a session, from connect to run, and takes what a person asks for.

    hub = Hub()
    server = serve(hub, "127.0.0.1", 8010)
    hub.publish(msgspec.json.encode(snapshot))  # by the worker, up to 30 times a second
    ask = hub.commands.get_nowait()             # Ask(do=Command.NEXT)

`static/` is the page itself: no build step, and no address outside itself.
"""

from .app import Ask, Hub
from .server import Server, serve

__all__ = ["Ask", "Hub", "Server", "serve"]
