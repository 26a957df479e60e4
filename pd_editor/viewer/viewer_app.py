"""The web application: one server, one workspace per browser tab."""

import hashlib
import json
import logging
import os
import secrets
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final

import viser

from pd_editor.base.errors import LargeMapError, LargeSceneError, PdEditorError
from pd_editor.base.regular_file import read_regular, state_folder
from pd_editor.editor.scenario_store import open_part
from pd_editor.experiments.scene_index.index_file import index_place
from pd_editor.generation.generators import catalogue_with
from pd_editor.scene.av2_io.upload import MAX_UPLOAD_BYTES
from pd_editor.scene.base_reference import SceneCut
from pd_editor.scene.formats.dataset import DatasetIndex
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_cut import FUTURE_S, densest_windows
from pd_editor.viewer.browser_session import BrowserSession
from pd_editor.viewer.server.server_guard import (
    TOKEN_FIELD,
    check_values,
    guarded_server,
    is_loopback,
)
from pd_editor.viewer.state.index_run import IndexRun
from pd_editor.viewer.state.session_shelf import SessionShelf
from pd_editor.viewer.state.workspace import UploadedZip, Workspace, zip_of_several

_LOG = logging.getLogger(__name__)
DEFAULT_DEMO: Final = "signalised-junction"
STORAGE_KEY: Final = "pd-editor-sessions"
STORAGE_TIMEOUT_S: Final = 2.0
VISITORS_NAME: Final = "visitors"
"""Folder of the state with kept work of browsers of other machines."""
ENDING_PATIENCE_S: Final = 12.0
"""How long a page that is loaded again waits for the end of the former one, whose worker
may be in the middle of a message."""
WARM_UP_AFTER_S: Final = 3.0
"""Delay before models are loaded, so that loading does not delay the first picture."""


@dataclass(frozen=True, kw_only=True)
class ViewerOptions:
    """Options of the server: its scenes, address, folders and models."""

    reference: str | None = None
    """Scenario of new pages; None: the list of all scenarios, over a demo."""
    cut: SceneCut = field(default_factory=SceneCut)
    """What is used of each recording that is opened by its place."""
    host: str = "127.0.0.1"
    port: int = 8080
    data_root: Path | None = None
    """Root of a dataset that pages list."""
    library: Path | None = None
    """Folder that all visitors share; None: each has one in ``state``."""
    state: Path | None = None
    """Folder of unfinished work; None: the user's own."""
    models: Sequence[str | Path] = ()
    """Models and plugins of one's own among the generators."""
    debug: bool = False
    """Whether the page offers viser's own settings and scene tree."""
    token: bool | None = None
    """Whether pages and connections are served only to those who know a token, which is
    part of ``address``; None: if other machines can reach it."""


class ViewerApp:
    """Serves the editor; every browser tab works on a workspace of its own."""

    def __init__(self, options: ViewerOptions) -> None:
        """Start serving.

        Raises:
            GenerationError: a folder holds no model.
            InputError: the scenario or the dataset root cannot be opened.
        """
        host, data_root = options.host, options.data_root
        self._generators = catalogue_with(options.models)
        self._cut = options.cut
        self._reference, self._is_long = options.reference or DEFAULT_DEMO, False
        self._starts_open = options.reference is None
        self._zip = _zip_at(Path(os.path.expanduser(self._reference)))
        if self._zip is not None:
            self._reference, self._starts_open = DEFAULT_DEMO, True
        self._scenario = self._open(self._cut)
        self._is_local = is_loopback(host)
        self._dataset = None if data_root is None else DatasetIndex(data_root)
        self._library, self._state = options.library, options.state or state_folder()
        self._index_run = self._new_index_run()
        self._shelves: dict[str, SessionShelf] = {}
        """Kept work by visitor."""
        self._workspaces: dict[str, Workspace] = {}
        self._tabs: dict[int, tuple[str, BrowserSession]] = {}
        self._is_debug = options.debug
        self._lock = threading.Condition()
        """Notified when a tab has ended, so that its workspace is free."""
        self._silent = threading.Lock()
        """Held while the page of a browser that did not answer is built."""
        self._warm_up = threading.Timer(WARM_UP_AFTER_S, self._warm_up_default)
        # No daemon: a thread that is ended inside torch aborts the process at its exit.
        self._warm_up.daemon = False
        self._warms_up = False
        has_token = not self._is_local if options.token is None else options.token
        secret = secrets.token_urlsafe(16) if has_token else None
        self.server = guarded_server(host, options.port, secret)
        self._query = f"/?{TOKEN_FIELD}={secret}" if secret else ""
        self.address = self.address_at(
            "localhost" if host in ("0.0.0.0", "::", "") else host
        )
        self.server.on_client_connect(self._connected)
        self.server.on_client_disconnect(self._disconnected)

    def _open(self, cut: SceneCut) -> Scenario:
        """What a cut leaves, or a part of it where that is too large or long."""
        try:
            return open_part(self._reference, cut)
        except LargeMapError as error:
            if cut.window is not None:
                raise
            (window,) = densest_windows(error.scene.lanes, 1)
            return self._open(replace(cut, window=window))
        except LargeSceneError as error:
            if cut.until_s is not None:
                raise
            self._is_long, now_s = True, cut.current_s or error.scene.observed_s
            return self._open(replace(cut, current_s=now_s, until_s=FUTURE_S))

    def address_at(self, host: str) -> str:
        """Address of the editor for browsers that reach this machine by a name."""
        name = f"[{host}]" if ":" in host else host
        return f"http://{name}:{self.server.get_port()}{self._query}"

    def run_forever(self) -> None:
        """Wait until interrupted; the caller stops the server then."""
        threading.Event().wait()

    def stop(self) -> None:
        """Stop serving; journals of unfinished work stay on disk."""
        self._warm_up.cancel()
        with self._lock:
            tabs = list(self._tabs.values())
            self._tabs.clear()
            workspaces = list(self._workspaces.values())
            self._workspaces.clear()
            shelves = list(self._shelves.values())
            self._shelves.clear()
        for _, tab in tabs:
            tab.close()
        if self._index_run is not None:
            self._index_run.close()
        for kept in (*workspaces, *shelves):
            kept.close()
        self.server.stop()

    def workspaces(self) -> tuple[Workspace, ...]:
        """All workspaces; of those without a tab, the one left last comes last."""
        with self._lock:
            return tuple(self._workspaces.values())

    def _new_index_run(self) -> IndexRun | None:
        """The index of the dataset: in its root, or in the state if it is read only."""
        if self._dataset is None:
            return None
        root, is_local = self._dataset.root, self._is_local
        return IndexRun(
            self._dataset, index_place(root, self._state, may_write=is_local)
        )

    async def _connected(self, client: viser.ClientHandle) -> None:
        # A thread of its own: some browsers never answer, and viser's threads are few.
        threading.Thread(
            target=self._receive, args=(client,), daemon=True, name="connection"
        ).start()

    def _receive(self, client: viser.ClientHandle) -> None:
        """Ask a browser for its earlier sessions, and give it a page."""
        try:
            visitor, known = _stored_keys(client)
        except (RuntimeError, TimeoutError) as error:
            _LOG.info("A browser's storage cannot be read: %s", error)
        else:
            self._open_tab(client, visitor, known)
            return
        # One after the other, so that many of them do not delay those that answer.
        with self._silent:
            tab = self._open_tab(client, "", [])
            if tab is not None:
                # How long the next browser that does not answer waits for the page of
                # the former one.
                tab.wait_until_built(10.0)

    def _open_tab(
        self, client: viser.ClientHandle, visitor: str, known: Sequence[str]
    ) -> BrowserSession | None:
        """Give a browser its earlier session or a new one; None if it has gone."""
        check_values(client)
        visitor = visitor or secrets.token_urlsafe(16)
        with self._lock:
            # Of a page that is loaded again, the former worker may not have ended yet.
            self._lock.wait_for(
                lambda: self._free(known) or not self._is_ending(known),
                ENDING_PATIENCE_S,
            )
            in_use = self._in_use()
            # A tab that is loaded again is the one that was left last.
            free = self._free(known)
            key = free[-1] if free else secrets.token_urlsafe(16)
            if not free:
                self._forget_old(in_use)
                self._workspaces[key] = Workspace(
                    self._scenario,
                    dataset=self._dataset,
                    index_run=self._index_run,
                    shelf=self._shelf_of(visitor),
                    is_local=self._is_local,
                    obeying={
                        name
                        for name, offer in self._generators.offers.items()
                        if "guidance" in offer.supports
                    },
                )
                self._workspaces[key].cut = replace(self._cut, window=None)
                start = replace(self._workspaces[key].start, is_open=self._starts_open)
                if self._zip is not None:
                    start = replace(start, source="zip")
                    own = replace(self._zip, ticked=set())
                    self._workspaces[key].uploaded_zip = own
                self._workspaces[key].start = start
            workspace = self._workspaces[key]
            tab = BrowserSession(
                client, workspace, self._generators, is_debug=self._is_debug
            )
            if client.client_id not in self.server.get_clients():
                return None
            self._tabs[client.client_id] = (key, tab)
            if not self._warms_up:
                self._warms_up = True
                self._warm_up.start()
            remembered = [k for k in known if k in self._workspaces and k != key]
        stored = {"visitor": visitor, "sessions": [key, *remembered]}
        client.local_storage.set_item(STORAGE_KEY, json.dumps(stored))
        # The page asks for a moment of what is too long.
        whole = partial(workspace.open_reference, self._reference, self._cut)
        tab.start(whole if self._is_long and not free else None)
        return tab

    def _disconnected(self, client: viser.ClientHandle) -> None:
        with self._lock:
            key, tab = self._tabs.get(client.client_id, ("", None))
        if tab is not None:
            # The key stays in use until the worker has ended, so that there is one writer.
            tab.close()
        with self._lock:
            self._tabs.pop(client.client_id, None)
            if key in self._workspaces:
                self._workspaces[key] = self._workspaces.pop(key)
            self._lock.notify_all()

    def _in_use(self) -> set[str]:
        """Keys of the workspaces that a tab has."""
        return {key for key, _ in self._tabs.values()}

    def _free(self, known: Sequence[str]) -> list[str]:
        """Those of some keys whose workspaces no tab has, the one left last at the end."""
        in_use = self._in_use()
        return [k for k in self._workspaces if k in known and k not in in_use]

    def _is_ending(self, known: Sequence[str]) -> bool:
        """Whether a tab with one of some keys is gone, but has not ended yet."""
        clients = self.server.get_clients()
        return any(
            key in known and client_id not in clients
            for client_id, (key, _) in self._tabs.items()
        )

    def _warm_up_default(self) -> None:
        """Load the default model ahead of its first generation, which reports errors.

        Others are loaded when they are used: there may be many, and each takes a while.
        """
        name, offer = next(iter(self._generators.offers.items()))
        if offer.warm_up is None:
            return
        try:
            offer.warm_up()
        except PdEditorError as error:
            _LOG.info("%s cannot be prepared: %s", name, error)

    def _shelf_of(self, visitor: str) -> SessionShelf:
        """Kept work of a visitor: of this machine all have one, other browsers their own.

        Folders are named by a hash, so that their names give no access.
        """
        name = (
            ""
            if self._is_local
            else hashlib.sha256(visitor.encode(errors="replace")).hexdigest()
        )
        if name not in self._shelves:
            folder = self._state / VISITORS_NAME / name[:32] if name else self._state
            self._shelves[name] = SessionShelf(folder, self._library)
        return self._shelves[name]

    def _forget_old(self, in_use: set[str]) -> None:
        idle = [key for key in self._workspaces if key not in in_use]
        # Number of workspaces without a browser that are kept; older ones are closed.
        for key in idle[: max(len(idle) - 16 + 1, 0)]:
            self._workspaces.pop(key).close()
        used = {workspace.shelf for workspace in self._workspaces.values()}
        for name, shelf in tuple(self._shelves.items()):
            if shelf not in used:
                self._shelves.pop(name).close()


def _zip_at(path: Path) -> UploadedZip | None:
    """A zip of several scenarios; None for all other places."""
    if path.suffix.lower() != ".zip" or not os.path.isfile(path):
        return None
    return zip_of_several({path.name: read_regular(path, max_bytes=MAX_UPLOAD_BYTES)})


def _stored_keys(client: viser.ClientHandle) -> tuple[str, list[str]]:
    """Keys of the visitor and of earlier sessions; other stored values are ignored."""
    text = client.local_storage.get_item(STORAGE_KEY, timeout=STORAGE_TIMEOUT_S)
    try:
        stored = json.loads(text or "{}")
    except (ValueError, RecursionError):
        stored = {}
    if not isinstance(stored, dict):
        return "", []
    visitor, keys = stored.get("visitor"), stored.get("sessions")
    return visitor if isinstance(visitor, str) else "", [
        key for key in (keys if isinstance(keys, list) else []) if isinstance(key, str)
    ]
