#!/usr/bin/env -S uv run --script
# /// script
# dependencies = ["nox>=2025.2.9"]
# ///
"""Tasks for contributors: `nox -l` lists them, `nox -s lint` runs one in its own environment."""

import nox

nox.needs_version = ">=2025.2.9"
nox.options.default_venv_backend = "venv"


def install(session: nox.Session, *groups: str) -> None:
    """Install the package and dependency groups in the versions of constraints.txt."""
    session.install("pip>=25.1")
    chosen = [part for group in groups for part in ("--group", group)]
    session.install("-c", "constraints.txt", "-e", ".", *chosen)


@nox.session
def lint(session: nox.Session) -> None:
    """Check style, spelling, types and the direction of imports."""
    install(session, "test", "lint")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("codespell")
    session.run("python", ".ci/prose.py")
    session.run("pyright")
    session.run("lint-imports")


@nox.session
def tests(session: nox.Session) -> None:
    """Run the tests; `nox -s tests -- -m long` runs those that take long."""
    install(session, "test")
    session.run("pytest", *session.posargs)


@nox.session(default=False)
def coverage(session: nox.Session) -> None:
    """Run the tests, write which lines they run to build/coverage, and fail below the limit."""
    install(session, "test")
    session.install("pytest-cov")
    reports = ("--cov-report=term", "--cov-report=html:build/coverage")
    untraced = "--ignore=tests/test_promises_interrupts.py"  # it interrupts the tracer, too
    session.run("pytest", "--cov", untraced, *reports, *session.posargs)


@nox.session(default=False)
def docs(session: nox.Session) -> None:
    """Build the documentation into build/docs."""
    install(session, "docs", "test")
    session.run("sphinx-build", "-W", "-n", "docs", "build/docs", *session.posargs)


if __name__ == "__main__":
    nox.main()
