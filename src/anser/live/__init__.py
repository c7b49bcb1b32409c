"""The live page: a scenario edited in the browser, planned at once, flown and saved; served on this machine only.

===============  =========================================================================================
``notebook``     entry points in Python: the page in a notebook or browser
``server``       the web server
``sessions``     requests of a page (``messages``: their format) and the threads that answer
``answers``      plan, or reasons for its refusal, as data for the page; ``controls``: sliders, new tables
``documents``    reading and saving of scenario files, confined to one folder
``preparation``  compilation before it is needed, in a process of low priority
``page``         the page as one HTML file, live or with recorded answers
===============  =========================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
