"""Draws the PNG icons in `public/icons/` from `app.svg`: `python web/icons.py`, after the SVG has changed."""

from pathlib import Path

from playwright.sync_api import sync_playwright

_ICONS = Path(__file__).parent / "public" / "icons"
# A maskable icon may lose everything outside the middle; app.svg leaves that free.
_FILES = {"icon-192.png": (192, 0.19), "icon-512.png": (512, 0.19), "maskable-512.png": (512, 0.0)}


def main() -> None:
    drawing = (_ICONS / "app.svg").read_text("utf-8")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        for name, (size, rounding) in _FILES.items():
            page = browser.new_page(viewport={"width": size, "height": size})
            shape = f"svg {{ width: {size}px; border-radius: {rounding * size}px; display: block }}"
            page.set_content(f"<style>body {{ margin: 0 }} {shape}</style>{drawing}")
            page.screenshot(path=_ICONS / name, omit_background=True)
        browser.close()


if __name__ == "__main__":
    main()
