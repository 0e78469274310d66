"""The language server of .scene files: diagnostics, completion, hover, navigation and edits over the Language Server Protocol.

May import: lang, compiler, live.
Begin with `server.py`: it lists the requests. `document.py` holds the text of a file in pieces that are parsed alone.
"""
