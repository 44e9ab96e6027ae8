# SPDX-License-Identifier: MIT
"""A champion as one HTML file: the walk, the controller at work, its C, and what is known of it. See docs/report.md."""

from bitneat.report.page.assemble import Page, Sources, build_page, page_code

__all__ = ["Page", "Sources", "build_page", "page_code"]
