"""What axe, the checker of the browser makers, finds wrong with a page for people who need more."""

from importlib.resources import files

GRAVE = ("serious", "critical")


def grave_findings(tab, tags=("wcag2a", "wcag2aa", "wcag21a", "wcag21aa")):
    """Return what axe finds serious or critical on the page in `tab`: rule, element, help."""
    axe = files("axe_playwright_python").joinpath("axe.min.js").read_text("utf-8")
    # Evaluated by the browser's own console, which a page's content security policy leaves alone
    tab.evaluate(axe)
    found = tab.evaluate("tags => axe.run({ runOnly: tags })", list(tags))
    return [
        f"{one['id']} ({one['impact']}): {one['help']}: {node['html'][:120]}"
        for one in found["violations"]
        if one["impact"] in GRAVE
        for node in one["nodes"]
    ]
