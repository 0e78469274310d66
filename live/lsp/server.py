"""The language server: each request of the editor, answered by the module for it. Checks run in a thread of their own."""

from __future__ import annotations

import asyncio
import logging
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from lsprotocol import types
from pygls.exceptions import JsonRpcException
from pygls.lsp.server import LanguageServer

from ...lang.distribution import VERSION
from ..scene_files import import_usd
from . import completion, edits, messages, navigation
from .document import Document
from .frames import Frames
from .messages import Checked
from .places import Places
from .project import Project, path_of
from .protocol import Protocol

PAUSE = 0.05  # seconds without a change before a check
T = TypeVar("T")


class Server(LanguageServer):
    """A server of one editor: its project, and the results of the last checks by path."""

    def __init__(self, allow: Sequence[Path]) -> None:
        full = types.TextDocumentSyncKind.Full
        super().__init__("maquette", VERSION, text_document_sync_kind=full, protocol_cls=Protocol)
        self.project = Project()
        self.allow = tuple(allow)
        self.checked: dict[str, Checked] = {}
        self._waiting: dict[str, None] = {}
        self._published: set[str] = set()
        self._versions: dict[str, int] = {}  # of the texts that were checked
        self._checks: asyncio.Task[None] | None = None

    @property
    def places(self) -> Places:
        """The conversion of places to those of this editor."""
        return Places(self.project, self.workspace.position_codec)

    def answer(self, uri: str, with_document: Callable[[Document], T]) -> T | None:
        """The answer to a request on a file; None for a file that is not there."""
        document = self.project.document(path_of(uri))
        return None if document is None else with_document(document)

    def check(self, changed: str) -> None:
        """Check a changed file, then the open files that use it, in the background."""
        for path in self.project.open:
            if path == changed or changed in self.project.files(path):
                self._waiting[path] = None
        if self._checks is None or self._checks.done():
            self._checks = asyncio.get_running_loop().create_task(self._check_waiting())

    async def _check_waiting(self) -> None:
        while self._waiting:
            await asyncio.sleep(PAUSE)
            path = next(iter(self._waiting))
            del self._waiting[path]
            if path not in self.project.open:
                continue
            texts = {open_path: document.text for open_path, document in self.project.open.items()}
            version = self.project.versions[path]
            if any("usd" in document.text for used in self.project.files(path) if (document := self.project.document(used))):
                import_usd()  # here, as its first import beside other threads can deadlock
            result = await asyncio.to_thread(messages.check, path, texts, self.allow)
            if path in self.project.open and self.project.versions[path] == version:
                self.checked[path], self._versions[path] = result, version
                self.publish()

    def forget(self, path: str) -> None:
        """Drop the results of a file that is no longer open."""
        self.checked.pop(path, None)
        self._versions.pop(path, None)
        self.publish()

    def publish(self) -> None:
        """Send the diagnostics of all checked files, and clear those of files that have none any more."""
        by_file = messages.merged(self.checked.values())
        for path in {*by_file, *self._published}:
            opened = self.project.open.get(path)
            notes = messages.of_size(opened) if opened else ()
            items = [messages.to_client(d, path, self.places) for d in (*notes, *by_file.get(path, ())[: messages.MAX_MESSAGES])]
            version = self._versions.get(path)
            self.text_document_publish_diagnostics(types.PublishDiagnosticsParams(self.project.uri(path), items, version))
        self._published = {path for path, items in by_file.items() if items}


def make_server(allow: Sequence[Path] = ()) -> Server:
    """A server with all features. Scenes read files below their own folder and below each of `allow`."""
    server = Server(allow)
    _synchronize(server)
    _read(server)
    _write(server)
    return server


def _synchronize(server: Server) -> None:
    """Follow the texts of open files."""

    @server.feature(types.TEXT_DOCUMENT_DID_OPEN)
    def open_(params: types.DidOpenTextDocumentParams) -> None:
        opened = params.text_document
        if opened.language_id == "scene" or opened.uri.endswith(".scene"):  # else a text file of an editor that takes scenes for text
            server.check(server.project.change(opened.uri, opened.text, opened.version).path)

    @server.feature(types.TEXT_DOCUMENT_DID_CHANGE)
    def changed(params: types.DidChangeTextDocumentParams) -> None:
        if path_of(params.text_document.uri) not in server.project.open:
            return
        text = params.content_changes[-1].text
        server.check(server.project.change(params.text_document.uri, text, params.text_document.version).path)

    @server.feature(types.TEXT_DOCUMENT_DID_SAVE)
    def saved(params: types.DidSaveTextDocumentParams) -> None:
        server.check(path_of(params.text_document.uri))

    @server.feature(types.TEXT_DOCUMENT_DID_CLOSE)
    def closed(params: types.DidCloseTextDocumentParams) -> None:
        path = path_of(params.text_document.uri)
        server.project.close(params.text_document.uri)
        server.forget(path)
        server.check(path)

    @server.feature(types.WORKSPACE_DID_CHANGE_WATCHED_FILES)
    def touched(params: types.DidChangeWatchedFilesParams) -> None:
        for path in [*server.project.open]:
            server.check(path)


def _read(server: Server) -> None:
    """Requests that change nothing."""

    @server.feature(types.TEXT_DOCUMENT_COMPLETION, types.CompletionOptions(trigger_characters=[".", '"', "/", "(", ",", ":"]))
    def complete(params: types.CompletionParams) -> list[types.CompletionItem] | None:
        return server.answer(params.text_document.uri, lambda d: completion.complete(server.places, d, params.position))

    @server.feature(types.TEXT_DOCUMENT_HOVER)
    def hover(params: types.HoverParams) -> types.Hover | None:
        def show(document: Document) -> types.Hover | None:
            checked = server.checked.get(document.path)
            return navigation.hover(server.places, document, params.position, checked.values if checked else {})

        return server.answer(params.text_document.uri, show)

    @server.feature(types.TEXT_DOCUMENT_SIGNATURE_HELP, types.SignatureHelpOptions(["(", ","], [":"]))
    def signature(params: types.SignatureHelpParams) -> types.SignatureHelp | None:
        return server.answer(params.text_document.uri, lambda d: navigation.signature_help(server.places, d, params.position))

    @server.feature(types.TEXT_DOCUMENT_DEFINITION)
    def definition(params: types.DefinitionParams) -> types.Location | None:
        return server.answer(params.text_document.uri, lambda d: navigation.definition(server.places, d, params.position))

    @server.feature(types.TEXT_DOCUMENT_REFERENCES)
    def references(params: types.ReferenceParams) -> list[types.Location] | None:
        declared = params.context.include_declaration
        return server.answer(params.text_document.uri, lambda d: navigation.references(server.places, d, params.position, declared))

    @server.feature(types.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT)
    def highlight(params: types.DocumentHighlightParams) -> list[types.DocumentHighlight] | None:
        return server.answer(params.text_document.uri, lambda d: navigation.highlights(server.places, d, params.position))

    @server.feature(types.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
    def symbols(params: types.DocumentSymbolParams) -> list[types.DocumentSymbol] | None:
        return server.answer(params.text_document.uri, lambda d: navigation.symbols(server.places, d))

    @server.feature(types.TEXT_DOCUMENT_DOCUMENT_COLOR)
    def swatches(params: types.DocumentColorParams) -> list[types.ColorInformation] | None:
        return server.answer(params.text_document.uri, lambda d: edits.swatches(server.places, d))

    @server.feature(types.TEXT_DOCUMENT_COLOR_PRESENTATION)
    def color(params: types.ColorPresentationParams) -> list[types.ColorPresentation]:
        return edits.written(params.color)


def _write(server: Server) -> None:
    """Requests whose answers are edits."""

    @server.feature(types.TEXT_DOCUMENT_PREPARE_RENAME)
    def prepare(params: types.PrepareRenameParams) -> types.Range | None:
        def show(document: Document) -> types.Range:
            place = server.places.place(document, params.position)
            return server.places.within(document, navigation.renamed(server.project, document, *place).span)

        return _refusing(lambda: server.answer(params.text_document.uri, show))

    @server.feature(types.TEXT_DOCUMENT_RENAME, types.RenameOptions(prepare_provider=True))
    def rename(params: types.RenameParams) -> types.WorkspaceEdit | None:
        def edit(document: Document) -> types.WorkspaceEdit:
            return navigation.rename(server.places, document, params.position, params.new_name)

        return _refusing(lambda: server.answer(params.text_document.uri, edit))

    @server.feature(types.TEXT_DOCUMENT_FORMATTING)
    def layout(params: types.DocumentFormattingParams) -> list[types.TextEdit] | None:
        return server.answer(params.text_document.uri, lambda d: edits.formatted(server.places, d))

    @server.feature(types.TEXT_DOCUMENT_CODE_ACTION, types.CodeActionOptions([types.CodeActionKind.QuickFix]))
    def fix(params: types.CodeActionParams) -> list[types.CodeAction] | None:
        diagnostics = messages.merged(server.checked.values()).get(path_of(params.text_document.uri), ())
        return server.answer(params.text_document.uri, lambda d: [*edits.fixes(server.places, d, diagnostics, params.range)])


def _refusing(run: Callable[[], T]) -> T:
    """The result of a rename; its refusal as the error of the request."""
    try:
        return run()
    except navigation.RenameError as refusal:
        raise JsonRpcException(str(refusal), types.LSPErrorCodes.RequestFailed.value) from None


def _is_fault(record: logging.LogRecord) -> bool:
    """Whether a record is not of a refused request, which the editor shows."""
    return not (record.exc_info and isinstance(record.exc_info[1], JsonRpcException))


def serve(allow: Sequence[Path]) -> None:
    """Serve one editor over stdin and stdout until it says `exit`. What libraries print goes to stderr.

    Scenes read files below their own folder and below each of `allow`.
    """
    logging.getLogger("pygls.protocol.json_rpc").addFilter(_is_fault)
    out: Any = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    frames: Any = Frames(sys.stdin.buffer)
    make_server(allow).start_io(frames, out)
