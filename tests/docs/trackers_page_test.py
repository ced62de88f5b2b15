#!/usr/bin/env python3
"""trackers_page_test.py FOLDER [--data | --again [--video VTEST_AVI] | --pictures FOLDER]: the page trackers.html that docs/playground/build.cmake copied.

--data checks the recordings alone, without a browser: their shape, finite numbers, overlaps computed again, images. --again
makes the recording of the drawn clip once more by record.py, or with --video that of the pedestrian; the trackers are to follow as the
recorded ones. Otherwise the page is opened from its folder in chromium. Exit code 77: chromium, chromedriver, the video or OpenCV's module is
missing.
"""
import argparse
import base64
import importlib.util
import json
import math
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

import playground_test
from playground_test import check

TRACKERS = ['dpt', 'dpt_plus', 'lgt', 'kcf']
MOST_BYTES = 600_000  # of the recording
SAME = 0.9  # mean overlap of a tracker's boxes with those of the recording
playground_test.KEYS.update({'left': '\ue012', 'home': '\ue011', 'end': '\ue010', 'shift': '\ue008', 'space': ' '})


CLIPS = {'drawn': ('trackers-data.js', 'RECORDING'), 'pedestrian': ('pedestrian-data.js', 'PEDESTRIAN')}


def read(folder, name='drawn'):
    path, head = folder / CLIPS[name][0], f'const {CLIPS[name][1]} = '
    check(path.stat().st_size <= MOST_BYTES, f'{path.name} has {path.stat().st_size} bytes, more than {MOST_BYTES}')
    comment, text = path.read_text(encoding='ascii').split('\n', 1)
    check(comment.startswith('//') and text.startswith(head) and text.endswith(';\n'), f'{path.name} is not as record.py writes it')

    def refuse(value):
        raise AssertionError(f'{path.name}: {value} is not finite')
    return json.loads(text[len(head):-2], parse_constant=refuse)


def numbers(value, count, what):
    check(isinstance(value, list) and len(value) == count and all(type(v) in (int, float) and math.isfinite(v) for v in value),
          f'{what}: expected {count} finite numbers, found {value}')


def overlap(a, b):
    width, height = (max(0, min(a[i] + a[i + 2], b[i] + b[i + 2]) - max(a[i], b[i])) for i in (0, 1))
    return width * height / (a[2] * a[3] + b[2] * b[3] - width * height)


def jpeg_size(source, what):
    """Width and height in the header of a data address."""
    head = 'data:image/jpeg;base64,'
    check(source.startswith(head), f'{what} is not a JPEG')
    data, at = base64.b64decode(source[len(head):], validate=True), 2
    while data[at + 1] not in (0xC0, 0xC1, 0xC2):
        at += 2 + int.from_bytes(data[at + 2:at + 4], 'big')
    return int.from_bytes(data[at + 7:at + 9], 'big'), int.from_bytes(data[at + 5:at + 7], 'big')


def data(folder, name='drawn'):
    recording = read(folder, name)
    clip, trackers = recording['clip'], recording['trackers']
    count, size = len(clip['frames']), (clip['width'], clip['height'])
    check(jpeg_size(clip['background'], 'the background') == size, 'the background has another size than the clip')
    for t, (x, y, source) in enumerate(clip['frames']):
        width, height = jpeg_size(source, f'frame {t}')
        check(x >= 0 and y >= 0 and x + width <= size[0] and y + height <= size[1], f'frame {t} is not in the clip')
    check(('boxes' in clip) == (name == 'drawn'), 'only the drawn clip has true boxes')
    check(len(clip.get('boxes', clip['frames'])) == count, 'true boxes are missing')
    for t, box in enumerate(clip.get('boxes', [])):
        numbers(box, 4, f'true box {t}')
    for key in ('hidden', 'shaded'):
        numbers(clip[key], count, key)
        check(all(0 <= v <= 1 for v in clip[key]), f'{key}: not shares')
        check(max(clip[key]) > 0.3 or (name, key) == ('pedestrian', 'shaded'), f'{key}: the clip shows nothing of it')
    check([t['name'] for t in trackers] == TRACKERS, 'other trackers')
    for tracker in trackers:
        links = []
        check(len(tracker['frames']) == count, f'{tracker["name"]}: {len(tracker["frames"])} frames, the clip has {count}')
        for t, frame in enumerate(tracker['frames']):
            what = f'{tracker["name"]}, frame {t}'
            numbers(frame['box'], 4, f'{what}: box')
            if t == 0:
                check(set(frame) == {'box'} and (name != 'drawn' or frame['box'] == clip['boxes'][0]), f'{what}: not the start alone')
                continue
            numbers([frame[key] for key in ('angle', 'confidence', 'threshold')], 3, what)
            check(0 <= frame['confidence'] <= 1, f'{what}: confidence {frame["confidence"]}')
            check(('overlap' in frame) == (name == 'drawn'), f'{what}: an overlap needs a true box')
            if name == 'drawn':
                check(abs(frame['overlap'] - overlap(frame['box'], clip['boxes'][t])) < 1e-3, f'{what}: overlap {frame["overlap"]} is not that of the boxes')
            for i, part in enumerate(frame['parts']):
                numbers(part, 6, f'{what}, part {i}')
                # Updated parts reach the threshold, up to the rounding of the numbers to 0.001 and 0.0001.
                check(part[5] in (0, 1) and (not part[5] or part[4] >= frame['threshold'] - 1e-3), f'{what}, part {i}: updated below the threshold')
            links = frame.get('links', links)
            check(all(0 <= i < len(frame['parts']) and 0 <= j < len(frame['parts']) for i, j in links), f'{what}: a link without its part')
        parts = [len(f['parts']) for f in tracker['frames'][1:]]
        expected = {'dpt': {6}, 'dpt_plus': {6}, 'kcf': {0}}.get(tracker['name'])
        check(set(parts) == expected if expected else min(parts) > 0, f'{tracker["name"]}: {sorted(set(parts))} parts')
    dpt = trackers[0]['frames'][1:]
    check(any(not p[5] for f in dpt for p in f['parts']), 'no part of dpt waits while it is hidden')


def again(folder, video):
    """The trackers may differ a little with the kernels of another CPU or another OpenCV. Behind the post, lgt follows
    differences of one gray level in a few hundred pixels to another place: it is compared until then."""
    name = 'pedestrian' if video else 'drawn'
    old = read(folder, name)
    with tempfile.TemporaryDirectory() as made:
        options = ['--video', video] if video else []
        subprocess.run([sys.executable, folder / 'record.py', pathlib.Path(made) / CLIPS[name][0], *options], check=True)
        data(pathlib.Path(made), name)
        new = read(pathlib.Path(made), name)
    check(new['clip'].get('boxes') == old['clip'].get('boxes') and len(new['clip']['frames']) == len(old['clip']['frames']), 'another clip')
    for a, b in zip(old['trackers'], new['trackers']):
        end = next(t for t, hidden in enumerate(old['clip']['hidden']) if hidden > 0) if a['name'] == 'lgt' else None
        same = [overlap(f['box'], g['box']) for f, g in zip(a['frames'][:end], b['frames'])]
        check(statistics.mean(same) >= SAME, f'{a["name"]}: its boxes overlap those of the recording by {statistics.mean(same):.3f} in the mean; '
              'run docs/playground/record.py again, and look at the page')


class PageBrowser(playground_test.Browser):
    def idle(self):
        self.until('window.viewer && viewer.isIdle()', 30)

    def state(self):
        self.idle()
        return self.run('return viewer.state()')


def slide(browser, frame):
    browser.run(f'const s = document.getElementById("scrub"); s.value = {frame}; s.dispatchEvent(new Event("input"))')


def shown(browser, canvas):
    return browser.run(f'return document.getElementById("{canvas}").toDataURL()')


def slider(browser, page, recording):
    browser.open(page, '')
    state = browser.state()
    check(state['frame'] > 0 and state['parts'] > 0, 'does not open on a frame that shows parts')
    first = {canvas: shown(browser, canvas) for canvas in ('view', 'weights', 'quality')}
    slide(browser, 66)
    check(browser.state()['frame'] == 66, 'the slider did not move the frame')
    for canvas, value in first.items():
        check(shown(browser, canvas) != value, f'{canvas} does not show the frame of the slider')
    hidden = [i + 1 for i, part in enumerate(recording['trackers'][0]['frames'][66]['parts']) if not part[5]]
    check(len(hidden) > 1 and f'Not learning: parts {", ".join(map(str, hidden))}.' in browser.run('return document.getElementById("status").textContent'),
          'the status does not name the parts that do not learn')


def trackers(browser, page, recording):
    browser.open(page, '#frame=40')
    check(browser.run('return [...document.getElementById("tracker").options].map((o) => o.value)') == TRACKERS, 'other trackers in the list')
    for k, tracker in enumerate(recording['trackers']):
        browser.run(f'const s = document.getElementById("tracker"); s.selectedIndex = {k}; s.dispatchEvent(new Event("change"))')
        for frame in (1, 40, 119):
            slide(browser, frame)
            state = browser.state()
            parts = tracker['frames'][frame]['parts']
            check(state['tracker'] == tracker['name'] and state['parts'] == state['rows'] == len(parts), f'{tracker["name"]}: {state["rows"]} weights of {len(parts)} parts')
            weights = browser.run('return [...document.querySelectorAll("#parts tbody td:nth-child(2)")].map((c) => c.textContent)')
            check(all(abs(float(text) - part[4]) < 1e-3 for text, part in zip(weights, parts)), f'{tracker["name"]}: other weights')
        check(browser.run('return document.getElementById("weights-panel").hidden') == (not parts), f'{tracker["name"]}: the panel of weights')


def keyboard(browser, page, _):
    browser.open(page, '#tracker=dpt&frame=10')
    browser.press('right', 'right', 'left')
    check(browser.state()['frame'] == 11, 'arrow keys')
    browser.press(('shift', 'right'))
    check(browser.state()['frame'] == 21, 'Shift and an arrow key')
    browser.press('end')
    check(browser.state()['frame'] == 119, 'End')
    browser.press('home', '.', '.')
    state = browser.state()
    check(state['frame'] == 0 and state['selected'] == 1, 'Home, and the selected part')
    browser.press('2')
    check(browser.state()['tracker'] == 'dpt_plus', 'a digit chooses the tracker')
    browser.run('document.getElementById("scrub").focus()')
    browser.press('right')
    check(browser.state()['frame'] == 1, 'an arrow key on the slider moves by one frame')
    browser.call('POST', '/url', {'url': 'about:blank'})
    browser.call('POST', '/url', {'url': page + '#frame=100'})
    browser.idle()
    browser.run('document.getElementById("rate").value = "25"; document.getElementById("play").click()')
    browser.until('viewer.isIdle()', 30)
    check(browser.state()['frame'] == 119, 'playing does not end at the last frame')


def link(browser, page, _):
    browser.open(page, '#tracker=dpt_plus&frame=77&part=3&show=parts+best')
    state = browser.state()
    check((state['tracker'], state['frame'], state['selected']) == ('dpt_plus', 77, 2), f'the link leads to {state}')
    check(browser.run('return ["parts", "springs", "best", "true"].map((s) => document.getElementById("show-" + s).checked)') == [True, False, True, False], 'what is shown')
    browser.press('right')
    browser.until('location.hash === "#tracker=dpt_plus&frame=78&part=3&show=parts+best"', 10)
    box = browser.run('const b = document.getElementById("quality").getBoundingClientRect(); return [b.left + b.width / 2, b.top + b.height / 2]')
    browser.drag(box, [(-30, 0), (-60, 0)])
    check(browser.state()['frame'] < 60, 'a drag over a chart does not move the frame')


def clips(browser, page, _):
    browser.open(page, '#tracker=dpt_plus')
    check(browser.state()['clip'] == 'drawn', 'the page opens with another clip')
    first = shown(browser, 'view')
    browser.run('const s = document.getElementById("clip"); s.value = "pedestrian"; s.dispatchEvent(new Event("change"))')
    state = browser.state()
    check((state['clip'], state['tracker']) == ('pedestrian', 'dpt_plus'), f'the list of clips leads to {state}')
    check(state['frame'] > 0 and state['parts'] > 0, 'the pedestrian does not open on a frame that shows parts')
    check(shown(browser, 'view') != first, 'the frame is that of the other clip')
    check(browser.run('return document.getElementById("show-true").disabled && document.getElementById("overlaps").hidden'), 'an overlap without a true box')
    check('verlap' not in browser.run('return document.getElementById("status").textContent'), 'an overlap without a true box')
    browser.press('end')
    browser.until('location.hash.startsWith("#clip=pedestrian&tracker=dpt_plus&frame=132&")', 10)
    browser.call('POST', '/url', {'url': 'about:blank'})
    browser.open(page, '#clip=pedestrian&tracker=lgt&frame=100')
    state = browser.state()
    check((state['clip'], state['tracker'], state['frame']) == ('pedestrian', 'lgt', 100), f'the link leads to {state}')
    browser.run('const s = document.getElementById("clip"); s.value = "drawn"; s.dispatchEvent(new Event("change"))')
    check(browser.state()['clip'] == 'drawn' and not browser.run('return document.getElementById("overlaps").hidden'), 'back to the drawn clip')


def phone(browser, page, _):
    for dark in (False, True):
        browser.resize(375, 740, dark)
        for clip, name in [(clip, name) for clip in CLIPS for name in TRACKERS]:
            browser.open(page, f'#clip={clip}&tracker={name}&frame=60')
            check(browser.run('return document.documentElement.dataset.theme') == ('dark' if dark else 'light'), 'the theme is not the system\'s')
            width = browser.run('return document.scrollingElement.scrollWidth')
            check(width <= 375, f'{name}: {width} px wide on a phone of 375')
    browser.resize(1280, 800)


def pictures(browser, page, folder):
    folder.mkdir(parents=True, exist_ok=True)
    for clip, name, frame, show in (('drawn', 'dpt', 66, 'parts+springs+best+true'), ('drawn', 'lgt', 50, 'parts+springs'),
                                    ('drawn', 'kcf', 66, 'parts+true'), ('drawn', 'dpt_plus', 110, 'parts+springs'), ('pedestrian', 'dpt_plus', 30, 'parts+springs'), ('pedestrian', 'lgt', 90, 'parts')):
        for dark in (False, True):
            for width, height in ((1280, 800), (375, 1500)):
                browser.resize(width, height, dark)
                browser.open(page, f'#clip={clip}&tracker={name}&frame={frame}&show={show}')
                time.sleep(0.2)
                browser.picture(folder / f'{clip}-{name}-{"dark" if dark else "light"}-{width}.png')


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('folder', type=pathlib.Path)
    parser.add_argument('--data', action='store_true')
    parser.add_argument('--again', action='store_true')
    parser.add_argument('--video', type=pathlib.Path)
    parser.add_argument('--pictures', type=pathlib.Path)
    arguments = parser.parse_args()
    if arguments.data:
        for name in CLIPS:
            data(arguments.folder, name)
        return
    if arguments.again:
        if arguments.video and not arguments.video.is_file():
            print(f'skipped: {arguments.video}: no such file; `bash trackers/tools/demo.sh` fetches it')
            sys.exit(77)
        if arguments.video and not importlib.util.find_spec('cv2'):
            print('skipped: needs OpenCV\'s Python module (Debian package python3-opencv)')
            sys.exit(77)
        again(arguments.folder, arguments.video)
        return
    chromium, driver = shutil.which('chromium'), shutil.which('chromedriver')
    if not chromium or not driver:
        print('skipped: chromium or chromedriver is not there')
        sys.exit(77)
    page = (arguments.folder.resolve() / 'trackers.html').as_uri()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        browser = PageBrowser(chromium, driver, pathlib.Path(folder) / 'profile')
        try:
            if arguments.pictures:
                pictures(browser, page, arguments.pictures)
                return
            for part in (slider, trackers, keyboard, link, clips, phone):
                part(browser, page, read(arguments.folder))
                errors = browser.errors()
                check(not errors, f'{part.__name__}: the console: {errors}')
        finally:
            browser.close()


if __name__ == '__main__':
    main()
