#!/usr/bin/env python3
"""site_look_test.py SITE [PAGE...]: the built site in chromium, each page on a desktop and on a phone, light and dark.

No page is wider than the window. Text has a contrast of 4.5 to its ground (WCAG's AA) and at least 9 px. Letters of charts have 8 px, and
charts that are drawn on white are inverted in the dark. A heading that a link leads to is not hidden by the header. Of the reference's
thousand pages a few are read. Exit code 77: chromium or chromedriver is missing.
"""
import pathlib
import re
import shutil
import sys
import tempfile
import time

import matplotlib.image

from playground_test import Browser

SIZES = {'desktop': (1280, 900), 'phone': (390, 844)}
REFERENCE = ['index', 'annotated', 'files', 'functions', 'namespaceasterism', 'structasterism_1_1Summary', 'classasterism_1_1SpringSystem']
LEAST_CONTRAST, LEAST_TEXT, LEAST_LETTER = 4.5, 9, 8
LETTER = 17  # pixels in the PNG of a chart
SCREENSHOT = 'playground.png'  # white at its edge, but no chart
HEADINGS = 'locate.html#measured', 'python-reference.html#layout'  # the second one is in a fold on a phone

# Whether the heading that the address names is at this place.
LED = '''
const heading = document.getElementById(location.hash.slice(1)).querySelector("h2, h3"), {left, top, height} = heading.getBoundingClientRect();
return top < innerHeight / 2 && heading.contains(document.elementFromPoint(left + 2, top + height / 2));
'''

LOOK = r'''
const rgba = color => { const [r, g, b, a = 1] = color.match(/[\d.]+/g).map(Number); return [r, g, b, a]; };
const over = (top, ground) => [0, 1, 2].map(i => top[i] * top[3] + ground[i] * (1 - top[3]));
const ground = e => over(rgba(getComputedStyle(e).backgroundColor), e.parentElement ? ground(e.parentElement) : [255, 255, 255]);
const luminance = color => color.map(v => v / 255).map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
  .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
const problems = new Set(), width = document.documentElement.scrollWidth;
if (width > innerWidth) problems.add(`${width} px wide in a window of ${innerWidth}`);
const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (texts.nextNode()) {
  const text = texts.currentNode.textContent.trim(), e = texts.currentNode.parentElement;
  // Subscripts of equations may be smaller; browsers draw the items of a selection.
  if (!/[\p{L}\d]/u.test(text) || e.closest("script, style, noscript, select, svg, .katex, .visually-hidden")) continue;
  if (!e.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
  const style = getComputedStyle(e), below = ground(e), at = `${e.tagName.toLowerCase()}.${e.className}`;
  const [high, low] = [luminance(over(rgba(style.color), below)), luminance(below)].sort((a, b) => b - a);
  const contrast = (high + 0.05) / (low + 0.05), size = parseFloat(style.fontSize);
  if (contrast < %g) problems.add(`contrast ${contrast.toFixed(2)}: ${at}`);
  if (size < %g) problems.add(`${size.toFixed(1)} px: ${at}`);
}
for (const details of document.querySelectorAll("details")) details.open = true;
for (const image of document.images) image.loading = "eager";
const pictures = [...document.querySelectorAll("article img")].map(
  e => [e.src, e.naturalWidth, e.getBoundingClientRect().width, getComputedStyle(e).filter.includes("invert")]);
return [[...problems], pictures];
''' % (LEAST_CONTRAST, LEAST_TEXT)


def chart(path):
    """(least size of its letters, width, whether it is drawn on white) of a chart; None for a photograph."""
    if path.suffix == '.svg':
        text = path.read_text(encoding='utf-8')
        sizes = [float(size) for size in re.findall(r'font(?:-size)?[:=]\s*"?(?:[\w ]* )?([\d.]+)(?:px)?\b', text) if float(size) > 1]
        return min(sizes), float(re.search(r'viewBox="\S+ \S+ (\S+)', text)[1]), 'prefers-color-scheme' not in text
    if path.suffix != '.png' or path.name == SCREENSHOT:
        return None
    pixels = matplotlib.image.imread(path)
    edge = pixels[[0, -1], :, :3]
    return (LETTER, pixels.shape[1], True) if edge.min() > 0.99 else None


def picture_problems(pictures, dark):
    for address, natural, shown, inverted in pictures:
        path = pathlib.Path(address.removeprefix('file://'))
        if not natural:
            yield f'{path.name} is not shown'
        elif drawn := chart(path):
            letter, width, white = drawn
            if letter * shown / width < LEAST_LETTER:
                yield f'{path.name}: letters of {letter * shown / width:.1f} px'
            if dark and white != inverted:
                yield f'{path.name} is {"not " * (not inverted)}inverted in the dark'


def main():
    site = pathlib.Path(sys.argv[1]).resolve()
    chromium, driver = shutil.which('chromium'), shutil.which('chromedriver')
    if not chromium or not driver:
        print('skipped: chromium or chromedriver is not there')
        sys.exit(77)
    pages = [site / name for name in sys.argv[2:]] or [
        *sorted(site.glob('*.html')), *sorted((site / 'results').glob('*.html')), *(site / 'reference' / f'{name}.html' for name in REFERENCE)]
    problems = {}
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        browser = Browser(chromium, driver, folder)
        try:
            for device, (width, height) in SIZES.items():
                for dark in (False, True):
                    browser.resize(width, height, dark)
                    for page in pages:
                        browser.call('POST', '/url', {'url': page.as_uri()})
                        found, pictures = browser.run(LOOK)
                        for problem in [*found, *picture_problems(pictures, dark)]:
                            problems.setdefault(f'{device}, {"dark" if dark else "light"}: {problem}', page.relative_to(site))
                for address in HEADINGS:
                    browser.call('POST', '/url', {'url': 'about:blank'})
                    browser.call('POST', '/url', {'url': (site / address).as_uri().replace('%23', '#')})
                    end = time.monotonic() + 10  # it scrolls smoothly
                    while not (led := browser.run(LED)) and time.monotonic() < end:
                        time.sleep(0.2)
                    if not led:
                        problems[f'{device}: the link does not lead to the heading'] = address
        finally:
            browser.close()
    for problem, page in problems.items():
        print(f'{page}, {problem}')
    print(f'{len(pages)} pages, {len(problems)} problems')
    sys.exit(bool(problems))


if __name__ == '__main__':
    main()
