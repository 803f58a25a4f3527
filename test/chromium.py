"""A browser without a window."""

import os
import shutil
from contextlib import contextmanager

import pytest
from patience import PATIENCE


@contextmanager
def chromium():
    """Give a browser; skip the test where there is none, except in CI."""
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        reason = "there is no Chromium on this computer"
        pytest.fail(reason) if os.environ.get("CI") else pytest.skip(reason)
    with sync_playwright() as playwright:
        made = playwright.chromium.launch(
            executable_path=program, args=["--no-sandbox", "--disable-gpu"], timeout=1e3 * PATIENCE
        )
        yield made
        made.close()
