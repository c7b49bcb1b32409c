"""A report opened in a browser: its pictures, its colours, and its faults."""

import io
import json

import matplotlib.image
import numpy as np

WINDOW = (1010, 600)  # small: these machines draw the scene without a graphics card


def opened(browser, path):
    """Open a page, unless already open; faults and requests are counted from the opening."""
    if browser.run("location.href") == path.as_uri():
        browser.run(
            "anser.state.setFocus(anser.state.names[0]); anser.state.names.forEach((n) => anser.state.toggle(n, true));"
            "document.querySelector('[data-view=overview]').click(); anser.state.setTime(48)"
        )
        return browser
    browser.faults.clear()
    browser.requests.clear()
    browser.open(path)
    browser.settle()
    return browser


def is_clean(browser, path):
    external = [url for url in browser.requests if not url.startswith(("data:", "blob:"))]
    return browser.faults == [] and external == [path.as_uri()]


def picture_of(browser, selector):
    """Pixels of an element, as fractions of full intensity; scrolled to the top of the window."""
    browser.run(f"document.querySelector({json.dumps(selector)}).scrollIntoView()")
    browser.settle()
    box = browser.run(
        f"(() => {{ const b = document.querySelector({json.dumps(selector)}).getBoundingClientRect();"
        " return [b.left, b.top, b.right, Math.min(b.bottom, innerHeight - 70)].map(Math.round); })()"
    )
    whole = matplotlib.image.imread(io.BytesIO(browser.picture()))[..., :3]
    return whole[box[1] : box[3], box[0] : box[2]]


def has_color(picture, color):
    target = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    return int((np.abs(picture - target).max(axis=-1) < 0.06).sum())
