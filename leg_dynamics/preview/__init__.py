"""Moving pictures of a mechanism: one self-contained HTML page, or a live meshcat view on this machine."""

from __future__ import annotations

from leg_dynamics.preview.arrow import in_root_frame
from leg_dynamics.preview.cloud import Cloud
from leg_dynamics.preview.live import LiveView, show_live
from leg_dynamics.preview.page import write_html
from leg_dynamics.preview.still import find_chromium, write_still
from leg_dynamics.preview.walking import Walking

__all__ = ["Cloud", "LiveView", "Walking", "find_chromium", "in_root_frame", "show_live", "write_html", "write_still"]
