"""What people look at: curves, tables, the HTML report and the Rerun recording."""

from reports.html import build_report

__all__ = ["build_report"]
