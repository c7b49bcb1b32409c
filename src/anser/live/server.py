"""Web server of the live page, on this machine only; requests need a random token, and other pages are refused."""

import asyncio
import contextlib
import hmac
import secrets
import socket
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import uvicorn
from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from anser.live.answers import plain_problem
from anser.live.documents import DocumentFolder
from anser.live.messages import SIZE_MAX, ResumeRequest, read_message
from anser.live.page import render_live_page
from anser.live.preparation import Preparation
from anser.live.sessions import Workbench, queue_sender
from anser.report.flight_page import flight_page

HOST = "127.0.0.1"
_RESUME_TRIES = 10  # number of waits of 0.1 s for the end of a page's former web socket
_NOTEBOOK_ANCESTORS = "http://localhost:* http://127.0.0.1:*"


class LocalRequestsOnly:
    """Web application that refuses requests without the token, with a foreign Host header or from another origin."""

    def __init__(self, app: ASGIApp, port: int, token: str, ancestors: str) -> None:
        self._app, self._token = app, token
        self._hosts = {f"{name}:{port}" for name in (HOST, "localhost")}
        self._headers = [
            (b"cache-control", b"no-store"),
            (b"referrer-policy", b"no-referrer"),
            (b"x-content-type-options", b"nosniff"),
            (b"cross-origin-resource-policy", b"same-origin"),
            (b"content-security-policy", f"frame-ancestors 'self' {ancestors}".strip().encode()),
        ]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass an ASGI request on, or refuse it (HTTP status 403, or a closed web socket)."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, lambda message: send(self._with_headers(message)))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008, "reason": refusal})
        else:
            await PlainTextResponse(refusal, status_code=403)(scope, receive, send)

    def _with_headers(self, message: Any) -> Any:
        if message["type"] != "http.response.start":
            return message
        return {**message, "headers": [*message.get("headers", []), *self._headers]}

    def _refusal(self, scope: Scope) -> str | None:
        headers = [(name.lower(), value.decode("latin-1")) for name, value in scope["headers"]]
        hosts = [value for name, value in headers if name == b"host"]
        origins = [value for name, value in headers if name == b"origin"]
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return "the Host header names another server"
        if any(origin != f"http://{hosts[0]}" for origin in origins):
            return "the request comes from another page"
        if scope["type"] == "websocket" and not origins:
            return "the request names no page that it comes from"
        token = scope["path"].removeprefix("/").partition("/")[0]
        if not hmac.compare_digest(token.encode(), self._token.encode()):
            return "the address lacks the token that anser live printed"
        return None


def make_app(workbench: Workbench, port: int, token: str, ancestors: str = "") -> ASGIApp:
    """Return the web application of a workbench: page, reports of flights, and the page's web socket.

    Requests must have the `token` in the address and the `port` in the Host header. `ancestors` are addresses of pages
    that may embed the page (Content-Security-Policy).
    """

    async def page(_: Request) -> Response:
        return HTMLResponse(await run_in_threadpool(render_live_page))

    async def report(request: Request) -> Response:
        identifiers = [value for key, value in sorted(request.path_params.items()) if key != "token"]
        flights = [workbench.flights.get(identifier) for identifier in identifiers]
        if any(flight is None for flight in flights):
            return PlainTextResponse("this flight is no longer kept; fly it again", status_code=404)
        runs = [
            (flight.scenario.name if len(flights) == 1 else f"flight {k}", flight.dataset, flight.summary)
            for k, flight in enumerate(flights, 1)
            if flight is not None
        ]
        return HTMLResponse(await run_in_threadpool(flight_page, runs))

    async def page_socket(websocket: WebSocket) -> None:
        await websocket.accept()
        await _answer_messages(workbench, websocket)

    routes = [
        Route("/{token}/", page),
        Route("/{token}/report/{a}", report),
        Route("/{token}/compare/{a}/{b}", report),
        WebSocketRoute("/{token}/socket", page_socket),
    ]
    return LocalRequestsOnly(Starlette(routes=routes), port, token, ancestors)


async def _answer_messages(workbench: Workbench, websocket: WebSocket) -> None:
    """Answer the messages of one page until its web socket closes."""
    queue: asyncio.Queue[str] = asyncio.Queue()
    send = queue_sender(asyncio.get_running_loop(), queue)
    session = workbench.new_session()
    session.attach(send)

    async def write() -> None:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # the socket closes while a message is sent
            while True:
                await websocket.send_text(await queue.get())

    writer = asyncio.create_task(write())
    try:
        send(session.welcome())
        while True:
            received = await websocket.receive()
            if received["type"] == "websocket.disconnect":
                break
            if received.get("text") is None:
                await websocket.close(1003, "binary messages are refused")
                break
            try:
                request = read_message(received["text"])
            except (ValueError, ValidationError) as error:
                send({"type": "failed", "number": None, "problems": [plain_problem(_malformed(error))]})
                continue
            if isinstance(request, ResumeRequest):
                # a duplicated tab has the session of the first, which it must not take away
                for _ in range(_RESUME_TRIES):
                    if not workbench.is_attached(request.session):
                        session = workbench.resume(session, request.session)
                        session.attach(send)
                        break
                    await asyncio.sleep(0.1)
            await run_in_threadpool(session.handle, request)
    finally:
        session.detach(send)
        writer.cancel()


def _malformed(error: ValueError) -> str:
    if isinstance(error, ValidationError):
        detail = error.errors(include_url=False, include_input=False, include_context=False)[0]
        place = ".".join(map(str, detail["loc"]))
        return f"a malformed message: {place}: {detail['msg']}"
    return f"a malformed message: {error}"


class LiveServer:
    """Web server of the live page, in a thread of its own; raises ScenarioError if the document is not valid.

    Parameters
    ----------
    document
        Scenario as nested dictionaries and lists, as in a scenario file.
    folder
        Folder in which the page opens and saves scenario files.
    name
        Name of the document's file in the folder; None if the folder has no such file.
    in_notebook
        Whether notebooks on this machine may show the page inline.
    prepares
        Whether a process of low priority compiles programs in advance: to fly, and to explain a refused plan.
    """

    def __init__(
        self,
        document: Mapping[str, Any],
        folder: Path,
        name: str | None = None,
        *,
        in_notebook: bool = False,
        prepares: bool = False,
    ) -> None:
        wind = document.get("wind")
        field = wind.get("field") if isinstance(wind, Mapping) else None
        documents = DocumentFolder(folder, document.get("parts"), field)
        documents.scenario(dict(document))  # raises ScenarioError before anything is served
        self.workbench = Workbench(documents, name, dict(document))
        if prepares:
            self.workbench.preparation = Preparation(folder)
        self._socket = socket.create_server((HOST, 0))
        self.port, self.token = self._socket.getsockname()[1], secrets.token_urlsafe(24)
        app = make_app(self.workbench, self.port, self.token, _NOTEBOOK_ANCESTORS if in_notebook else "")
        self._server = uvicorn.Server(
            uvicorn.Config(
                app,
                log_level="error",
                access_log=False,  # addresses contain the token
                lifespan="off",
                ws="websockets-sansio",
                ws_max_size=SIZE_MAX,
                ws_per_message_deflate=False,  # compression takes longer than the way to a page on this machine
                timeout_graceful_shutdown=1,
            )
        )
        self._thread = threading.Thread(target=self._serve, name="anser live", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Address of the page, with the token."""
        return f"http://{HOST}:{self.port}/{self.token}/"

    def wait(self) -> None:
        """Wait until the server ends; Ctrl-C raises KeyboardInterrupt."""
        while self._thread.is_alive():
            self._thread.join(0.2)

    def close(self) -> None:
        """Stop the work of all pages and end the server."""
        self.workbench.close()
        self._server.should_exit = True
        self._thread.join(5.0)
        with contextlib.suppress(OSError):
            self._socket.close()

    def _serve(self) -> None:
        asyncio.run(self._server.serve(sockets=[self._socket]))
