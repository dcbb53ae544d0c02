"""The web server: on loopback alone, and only for who knows the token in the address."""

from __future__ import annotations

import hmac
import secrets
from typing import Any

import panel as pn
from bokeh.server.auth_provider import AuthProvider
from panel.io.server import get_server
from tornado.web import HTTPError

from inkjet_env.experiments.explore import style
from inkjet_env.experiments.explore.exploration import Exploration
from inkjet_env.experiments.explore.page import Page

LOOPBACK = "127.0.0.1"
TITLE = "inkjet explore"
LARGEST_MESSAGE = 500 * 2**20
"""Largest file that can be dropped, in bytes."""


class Token(AuthProvider):
    """Refuses every page and socket whose address lacks the token.

    Parameters
    ----------
    token : str
        The token.
    """

    def __init__(self, token: str) -> None:
        self.token = token
        super().__init__()

    @property
    def get_user(self) -> Any:
        """The check of a request: a user, or ``HTTPError`` 403."""

        def user(handler: Any) -> str:
            given = handler.get_query_argument("token", "")
            if not hmac.compare_digest(given.encode(), self.token.encode()):
                raise HTTPError(403, "the address needs the token that inkjet explore printed")
            return "here"

        return user

    @property
    def get_user_async(self) -> None:
        """None: the check is at once."""
        return None

    @property
    def login_url(self) -> str:
        """Never used: a request without the token is refused."""
        return "/"

    @property
    def get_login_url(self) -> None:
        """None: there is no login."""
        return None

    @property
    def login_handler(self) -> None:
        """None: there is no login."""
        return None

    @property
    def logout_url(self) -> None:
        """None: there is no login."""
        return None

    @property
    def logout_handler(self) -> None:
        """None: there is no login."""
        return None


def serve(exploration: Exploration, port: int = 0) -> tuple[Any, str]:
    """A server that is ready to run, and the address to open.

    Parameters
    ----------
    exploration : Exploration
        What every tab shows.
    port : int
        Port on loopback; 0 for any that is free.

    Returns
    -------
    server : panel.io.server.Server
        Call ``run_until_shutdown``.
    address : str
        The address with its token.
    """
    style.use()
    pn.config.throttled = False
    token = secrets.token_urlsafe(24)
    server = get_server(
        {"/": lambda: Page(exploration).layout}, port=port, address=LOOPBACK, title=TITLE, show=False, start=False,
        verbose=False, auth_provider=Token(token), websocket_max_message_size=LARGEST_MESSAGE,
        allow_websocket_origin=None, session_history=0,
    )  # fmt: skip
    return server, f"http://{LOOPBACK}:{server.port}/?token={token}"
