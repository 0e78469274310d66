"""The live window of `maquette watch`: follow files, draw each edit, serve a page on the loopback interface.

May import: lang, compiler, render.
Begin with `session.py`: it joins the studio (compile and draw), the watch of files and the pages. `page/` holds the page.
"""
