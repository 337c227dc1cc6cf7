"""A picture of a preview page at one time, taken by a headless Chromium where one is installed."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from leg_dynamics.errors import PreviewError, UnsupportedError

__all__ = ["CHROMIUM_NAMES", "chromium_flags", "find_chromium", "write_still"]

CHROMIUM_NAMES = ("chromium", "chromium-browser", "google-chrome")


def find_chromium() -> str | None:
    """Path of an installed Chromium or Chrome; None where there is none."""
    return next(filter(None, map(shutil.which, CHROMIUM_NAMES)), None)


def chromium_flags(profile: str | Path) -> list[str]:
    """Flags for a headless Chromium that draws WebGL in software and calls nobody; `profile` is its private folder."""
    flags = [
        "--headless",
        "--hide-scrollbars",
        "--use-gl=angle",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--disable-quic",
        "--no-first-run",
        "--no-default-browser-check",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--disable-dev-shm-usage",
        f"--user-data-dir={profile}",
    ]
    # Chromium refuses to run as root inside its own sandbox, which is how containers usually run.
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        flags.append("--no-sandbox")
    return flags


def write_still(
    html_path: str | Path,
    png_path: str | Path,
    time: float,
    *,
    size: tuple[int, int] = (1280, 960),
    timeout: float = 120.0,
) -> Path:
    """Photograph a page written by `write_html`.

    Parameters
    ----------
    html_path : str or Path
        The page.
    png_path : str or Path
        The picture to write.
    time : float
        Time of the motion, s; the page shows the nearest time that it has.
    size : tuple of int
        Width and height of the window, pixels.
    timeout : float
        Seconds to wait for the browser.

    Returns
    -------
    Path
        The picture written.

    Raises
    ------
    UnsupportedError
        No Chromium is installed.
    PreviewError
        The page does not exist, or the browser did not deliver a picture in time.
    """
    chromium = find_chromium()
    if chromium is None:
        raise UnsupportedError(
            f"a still needs a headless browser, and none of {', '.join(CHROMIUM_NAMES)} is installed; "
            "open the page in any browser instead"
        )
    page, picture = Path(html_path).resolve(), Path(png_path).resolve()
    if not page.is_file():
        raise PreviewError(f"there is no page {page}; write it first with write_html", path=page)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        shot = Path(profile) / "still.png"
        command = [
            chromium,
            *chromium_flags(profile),
            f"--window-size={size[0]},{size[1]}",
            "--virtual-time-budget=5000",
            f"--screenshot={shot}",
            f"{page.as_uri()}#t={float(time)!r}",
        ]
        try:
            done = subprocess.run(command, capture_output=True, timeout=timeout, check=False)
        except subprocess.TimeoutExpired:
            raise PreviewError(
                f"{chromium} took no picture of {page} within {timeout:g} s; allow more time", path=page
            ) from None
        if not shot.is_file():
            reason = done.stderr.decode("utf-8", "replace").strip().splitlines()[-1:] or ["no message"]
            raise PreviewError(f"{chromium} took no picture of {page}: {reason[0]}", path=page, reason=reason[0])
        shutil.move(shot, picture)
    return picture
