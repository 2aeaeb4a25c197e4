"""The documentation as it is built: links lead somewhere, nothing is fetched, phones show it.

`NPEND_DOCS=build/docs pytest -m long tests/test_site.py` takes pages that are built already.
"""

import os
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from accessibility import grave_findings
from scripts import run_python

pytestmark = pytest.mark.long

ROOT = Path(__file__).parent.parent
MAIN = ("index", "tutorial", "gallery", "live_page", "tasks/swing_up", "howto/simulate",
        "explanation/tensions", "results", "commands", "reference/physics")  # fmt: skip
WIDTH = 390  # of a phone


class Page(HTMLParser):
    """Names and addresses in a page."""

    def __init__(self, path):
        super().__init__()
        self.names, self.links, self.fetched = set(), [], []
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.names |= {given.get("id"), given.get("name")}
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])
        elif tag == "link" and given.get("rel") not in ("canonical", "index", "next", "prev",
                                                        "search", "author"):  # fmt: skip
            self.fetched.append(given.get("href"))
        elif given.get("src"):
            self.fetched.append(given["src"])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    if "NPEND_DOCS" in os.environ:
        return Path(os.environ["NPEND_DOCS"])
    for library in ("furo", "latex2mathml", "myst_parser", "sphinx", "sphinx_design"):
        pytest.importorskip(library, reason="the extra docs is not installed")
    if sys.version_info < (3, 11):
        pytest.skip("Sphinx needs Python 3.11")
    out = tmp_path_factory.mktemp("site")
    run_python("-m", "sphinx", "-q", "-W", "-n", ROOT / "docs", out)
    return out


@pytest.fixture(scope="module")
def pages(site):
    return {path: Page(path) for path in sorted(site.rglob("*.html"))}


def test_every_link_within_the_pages_leads_somewhere(pages):
    dead = []
    for path, page in pages.items():
        for link in page.links:
            address = urlsplit(link)
            if address.scheme:
                continue
            target = (path.parent / unquote(address.path)).resolve() if address.path else path
            if not target.exists():
                dead.append(f"{path.name}: {link}")
            elif target.suffix == ".html" and address.fragment:
                named = unquote(address.fragment) in pages[target].names
                dead += [] if named else [f"{path.name}: {link}"]
    assert dead == []
    assert sum(len(page.links) for page in pages.values()) > 1000


def test_the_pages_name_nothing_that_would_be_fetched_from_elsewhere(site, pages):
    outside = {
        (path.name, address)
        for path, page in pages.items()
        for address in page.fetched
        if urlsplit(address or "").netloc
    }
    assert outside == set()
    for path in site.rglob("*.css"):
        addresses = re.findall(r"url\(['\"]?([^)'\"]+)", path.read_text("utf-8"))
        assert not [one for one in addresses if urlsplit(one).netloc], path.name


@pytest.fixture(scope="module")
def tab(browser):
    context = browser.new_context(viewport={"width": WIDTH, "height": 844}, offline=True)
    yield context.new_page()
    context.close()


@pytest.mark.parametrize("name", MAIN)
def test_a_main_page_fits_a_phone_is_accessible_and_fetches_nothing(name, site, tab):
    pytest.importorskip("axe_playwright_python", reason="axe is not installed")
    requests = []
    tab.on("request", lambda request: requests.append(request.url))
    tab.goto((site / f"{name}.html").as_uri())
    assert tab.evaluate("document.documentElement.scrollWidth") <= WIDTH
    assert [url for url in requests if not url.startswith(("file:", "data:"))] == []
    assert grave_findings(tab) == []
    if name in ("tasks/swing_up", "explanation/tensions"):
        assert tab.locator("math mo").count() > 3  # drawn by the browser itself
