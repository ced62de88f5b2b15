#!/usr/bin/env python3
"""playground_test.py FOLDER NATIVE [--pictures FOLDER]: the playground that docs/playground/build.cmake made, in a browser.

Opens the page from its folder in chromium, by chromedriver and plain HTTP, and compares what it finds with NATIVE
(playground_native.cpp), the solver compiled for this machine. Exit code 77: the solver, chromium or chromedriver is missing.
"""
import argparse
import base64
import json
import pathlib
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

METHODS = ['ida', 'ncg', 'lbfgs', 'newton']
# A system on which CG does not converge.
HARD = 'hard-case'
# A system in which Newton's method leaves a saddle: the last bit of a function of the C library grows on the way.
SADDLE = 'contradiction'
FRAME = 1000 / 60  # ms
KEYS = {'right': '\ue014', 'enter': '\ue007', 'delete': '\ue017', 'control': '\ue009'}


class Browser:
    """The few commands of WebDriver that the test needs."""

    def __init__(self, chromium, driver, folder):
        with socket.socket() as free:
            free.bind(('127.0.0.1', 0))
            port = free.getsockname()[1]
        self.process = subprocess.Popen([driver, f'--port={port}'], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.url = f'http://127.0.0.1:{port}'
        arguments = ['--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run', '--disable-background-networking',
                     '--disable-component-update', '--disable-sync', '--hide-scrollbars', '--window-size=1280,800', f'--user-data-dir={folder}']
        for _ in range(300):
            try:
                self.call('GET', '/status')
                break
            except OSError:
                time.sleep(0.1)
        session = self.call('POST', '/session', {'capabilities': {'alwaysMatch': {
            'goog:chromeOptions': {'binary': chromium, 'args': arguments}, 'goog:loggingPrefs': {'browser': 'ALL'}, 'timeouts': {'script': 120000}}}})
        self.url += '/session/' + session['sessionId']

    def call(self, verb, path, body=None):
        request = urllib.request.Request(self.url + path, method=verb, data=None if body is None else json.dumps(body).encode(),
                                         headers={'Content-Type': 'application/json'})
        try:
            with urllib.request.urlopen(request, timeout=300) as answer:
                return json.load(answer)['value']
        except urllib.error.HTTPError as error:
            raise RuntimeError(json.load(error)['value']['message']) from None

    def close(self):
        try:
            self.call('DELETE', '')
        except (OSError, RuntimeError):
            pass
        self.process.terminate()
        self.process.wait()

    def run(self, script):
        return self.call('POST', '/execute/sync', {'script': script, 'args': []})

    def wait(self, script):
        """The value of a promise."""
        return self.call('POST', '/execute/async', {'script': f'const done = arguments[0]; ({script}).then(done, (e) => done("error: " + e));', 'args': []})

    def until(self, condition, seconds=120):
        end = time.monotonic() + seconds
        while not self.run(f'return {condition}'):
            check(time.monotonic() < end, f'not within {seconds} s: {condition}')
            time.sleep(0.05)

    def open(self, page, state):
        self.call('POST', '/url', {'url': 'about:blank'})
        self.call('POST', '/url', {'url': page + state})
        self.idle()

    def idle(self):
        self.until('window.playground && playground.isIdle()')

    def errors(self):
        return [entry['message'] for entry in self.call('POST', '/se/log', {'type': 'browser'}) if entry['level'] in ('SEVERE', 'WARNING')]

    def drag(self, begin, moves):
        steps = [{'type': 'pointerMove', 'duration': 0, 'x': round(begin[0]), 'y': round(begin[1])}, {'type': 'pointerDown', 'button': 0}]
        for x, y in moves:
            steps.append({'type': 'pointerMove', 'duration': 16, 'x': round(begin[0] + x), 'y': round(begin[1] + y)})
        steps.append({'type': 'pointerUp', 'button': 0})
        self.call('POST', '/actions', {'actions': [{'type': 'pointer', 'id': 'mouse', 'parameters': {'pointerType': 'mouse'}, 'actions': steps}]})
        time.sleep(0.1)
        self.idle()

    def press(self, *keys):
        actions = []
        for key in keys:
            chord = key if isinstance(key, tuple) else (key,)
            actions += [{'type': 'keyDown', 'value': KEYS.get(k, k)} for k in chord]
            actions += [{'type': 'keyUp', 'value': KEYS.get(k, k)} for k in reversed(chord)]
        self.call('POST', '/actions', {'actions': [{'type': 'key', 'id': 'keys', 'actions': actions}]})
        time.sleep(0.1)
        self.idle()

    def resize(self, width, height, dark=False):
        phone = width < 600
        self.call('POST', '/goog/cdp/execute', {'cmd': 'Emulation.setDeviceMetricsOverride', 'params': {
            'width': width, 'height': height, 'deviceScaleFactor': 1, 'mobile': phone}})
        self.call('POST', '/goog/cdp/execute', {'cmd': 'Emulation.setEmulatedMedia', 'params': {
            'features': [{'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'}]}})

    def picture(self, path):
        path.write_bytes(base64.b64decode(self.call('GET', '/screenshot')))


def check(holds, text):
    if not holds:
        raise AssertionError(text)


class Test:
    def __init__(self, browser, page, native, folder):
        self.browser, self.page, self.native, self.file = browser, page, native, folder / 'system.json'
        self.same, self.solves = 0, 0

    def solve_natively(self, text, method, tolerance):
        self.file.write_text(text)
        done = subprocess.run([self.native, self.file, method, str(tolerance)], capture_output=True, text=True, check=False)
        check(done.returncode == 0, f'native: {done.stderr}')
        return json.loads(done.stdout)

    def compare(self, what, method, tolerance, most=1e-12):
        """The page's result with the native solver's, of the page's own system."""
        text = self.browser.run('return playground.system()')
        result = self.browser.run('return playground.result()')
        native = self.solve_natively(text, method, tolerance)
        for key in ('status', 'iterations'):
            check(result[key] == native[key], f'{what}: {key} {result[key]}, natively {native[key]}')
        off = max(abs(a - b) for a, b in zip(result['x'], native['x'])) / max(map(abs, native['x']))
        check(off <= most, f'{what}: {off} of its size from the native result')
        check(abs(result['bound'] - native['bound']) <= 1e-9 * abs(native['bound']), f'{what}: lower bound {result["bound"]}, natively {native["bound"]}')
        self.solves += 1
        self.same += result['x'] == native['x']
        return result

    def presets(self):
        """Every system of the list by every method."""
        self.browser.open(self.page, '')
        for preset in self.browser.run('return PRESETS.map((p) => p.id)'):
            ends = []
            for method in METHODS:
                self.browser.open(self.page, f'#preset={preset}&method={method}')
                check(self.browser.run('return document.getElementById("preset").value') == preset, f'{preset} was not opened')
                result = self.compare(f'{preset}, {method}', method, 1e-8, 1e-6 if preset == SADDLE else 1e-12)
                ends.append(f'{method} {result["iterations"]}')
                check(preset == HARD or result['status'] == 'converged', f'{preset}, {method}: {result["status"]}')
            print(f'{preset}: iterations of {", ".join(ends)}')
        check(not self.browser.errors(), f'the console: {self.browser.errors()}')

    def dragging(self):
        self.browser.open(self.page, '#preset=parts&method=newton&tolerance=1e-12')
        before = json.loads(self.browser.run('return playground.system()'))
        self.browser.drag(self.browser.run('return playground.place("node", 2)'), [(10 * i, -8 * i) for i in range(1, 12)])
        after = json.loads(self.browser.run('return playground.system()'))
        check(before['anchors'] == after['anchors'] and before['start'] != after['start'], 'dragging a part did not move the start')
        self.compare('a dragged part', 'newton', 1e-12)
        self.browser.drag(self.browser.run('return playground.place("anchor", 1)'), [(6 * i, 9 * i) for i in range(1, 12)])
        moved = json.loads(self.browser.run('return playground.system()'))
        check(moved['anchors'][1] != after['anchors'][1] and moved['anchors'][0] == after['anchors'][0], 'the anchor was not dragged')
        self.compare('a dragged anchor', 'newton', 1e-12)

    def space(self):
        def places(kind):
            return [self.browser.run(f'return playground.place("{kind}", {i})') for i in range(8)]
        self.browser.open(self.page, '#preset=box&method=newton&tolerance=1e-12&turn=0,0')
        before = json.loads(self.browser.run('return playground.system()'))
        begin = [round(v) for v in places('anchor')[1]]
        self.browser.drag(begin, [(6 * i, -9 * i) for i in range(1, 12)])
        after = json.loads(self.browser.run('return playground.system()'))
        old, new = before['anchors'][1], after['anchors'][1]
        check(new[0] > old[0] and new[1] < old[1] and new[2] == old[2], f'the anchor moved from {old} to {new}')
        self.compare('a dragged anchor in space', 'newton', 1e-12)
        # An empty place turns the view, about the vertical axis and about the horizontal one.
        corner = self.browser.run('const b = document.getElementById("view").getBoundingClientRect(); return [Math.ceil(b.left) + 8, Math.ceil(b.top) + 8]')
        still = places('node')
        self.browser.drag(corner, [(5 * i, 3 * i) for i in range(1, 12)])
        check(still != places('node') and json.loads(self.browser.run('return playground.system()')) == after, 'the view did not turn, or the system changed')
        state = self.browser.wait('playground.hash()')
        check('turn=0.550,-0.330' in state, f'the turn is not in the link {state[-40:]}')
        self.browser.open(self.page, state)
        check(self.browser.wait('playground.hash()') == state, 'the link leads to another view')
        # A part moves in the plane of the screen, and ends under the pointer.
        begin = [round(v) for v in places('anchor')[2]]
        self.browser.drag(begin, [(-4 * i, 5 * i) for i in range(1, 12)])
        end = places('anchor')[2]
        check(max(abs(begin[0] - 44 - end[0]), abs(begin[1] + 55 - end[1])) < 1e-6, f'the anchor is at {end}')
        self.browser.drag([round(v) for v in places('node')[5]], [(3 * i, 4 * i) for i in range(1, 12)])
        self.compare('a dragged part in space', 'newton', 1e-12)
        self.browser.run('document.getElementById("view").focus()')
        still = places('node')
        self.browser.press('6')
        check(places('node') != still, 'the key turned nothing')
        space = self.browser.run('return playground.system()')
        self.browser.run('document.getElementById("from-random").click()')
        self.browser.press(('control', 'z'))
        check(self.browser.run('return playground.system()') == space, 'undo')

    def files_and_links(self):
        text = self.browser.run('return playground.system()')
        ours = self.solve_natively(text, 'newton', 1e-12)['system']
        check(ours == json.loads(text), 'the library reads another system than the page wrote')
        self.browser.run(f'playground.read({json.dumps(json.dumps(ours))})')
        self.browser.idle()
        check(json.loads(self.browser.run('return playground.system()')) == ours, 'the page reads another system than the library wrote')
        for bad, reason in (('{"asterism_system": 1}', 'dim is missing'), ('[3]', 'expected a system'), (text.replace('"fixed"', '"fxed"').replace('"dim":2', '"dim":4'), 'dim')):
            said = self.browser.run(f'try {{ playground.read({json.dumps(bad)}); return "nothing" }} catch (e) {{ return e.message }}')
            check(reason in said, f'a bad file is answered with: {said}')
        state = self.browser.wait('playground.hash()')
        result = self.browser.run('return playground.result()')
        self.browser.open(self.page, state)
        check(self.browser.run('return playground.system()') == text, 'the link holds another system')
        check(self.browser.run('return playground.result()')['x'] == result['x'], 'the link leads to another result')

    def keyboard(self):
        def system():
            return json.loads(self.browser.run('return playground.system()'))
        self.browser.open(self.page, '#preset=parts&method=ida')
        first = system()
        self.browser.run('document.getElementById("view").focus()')
        self.browser.press('.', 'right')
        check(system()['start'][3] != first['start'][3], 'the arrow key moved no part')
        self.browser.press('a', 'right')
        check(system()['anchors'][3][0] > first['anchors'][3][0], 'the arrow key moved no anchor')
        self.browser.press('a', 'l', '.', 'enter')
        check(len(system()['links']) == 9, 'the link was not cut')
        self.browser.press(('control', 'z'))
        check(len(system()['links']) == 10, 'undo')
        self.browser.press('x')
        check(system().get('fixed') == [4], 'the part is not fixed')
        self.browser.press('delete')
        check(len(system()['anchors']) == 4 and len(system()['links']) == 6 and 'fixed' not in system(), 'the part is still there')
        check(self.browser.run('return playground.result()')['status'] == 'converged', 'not solved without the part')

    def mouse_links(self):
        self.browser.open(self.page, '#preset=cable&method=newton')
        self.browser.run('document.querySelector("input[value=link]").click()')
        a, b = (self.browser.run(f'return playground.place("node", {i})') for i in (3, 20))
        self.browser.drag(a, [((b[0] - a[0]) * t / 5, (b[1] - a[1]) * t / 5) for t in range(1, 6)])
        links = json.loads(self.browser.run('return playground.system()'))['links']
        check(links[-1] == [3, 20] and len(links) == 25, 'no link was drawn')
        self.browser.run('document.querySelector("input[value=add]").click()')
        self.browser.drag([a[0], a[1] - 60], [])
        check(len(json.loads(self.browser.run('return playground.system()'))['anchors']) == 26, 'no part was added')

    def second_minimum(self):
        self.browser.open(self.page, '#preset=two-minima&method=ida')
        first = self.browser.run('return playground.result()')
        self.browser.run('document.getElementById("staircase").click()')
        second = self.browser.run('return playground.second()')
        check(second and second['energy'] < first['energy'], 'the staircase found nothing lower')
        self.browser.run('document.getElementById("take").click()')
        time.sleep(0.1)
        self.browser.idle()
        result = self.browser.run('return playground.result()')
        check(abs(result['energy'] - second['energy']) <= 1e-9 * second['energy'], 'the second minimum was not taken')

    def speed(self):
        for method in METHODS:
            self.browser.open(self.page, f'#preset=cloth&method={method}')
            self.browser.run('playground.times()')
            self.browser.drag(self.browser.run('return playground.place("node", 55)'), [(3 * i, 2 * i) for i in range(1, 60)])
            times = sorted(self.browser.run('return playground.times()'))
            print(f'100 parts, a part dragged, {method}: solving, covariances and drawing take {statistics.median(times):.1f} ms in the median '
                  f'and {times[len(times) // 10]:.1f} in the first decile of {len(times)}; a frame is {FRAME:.1f} ms')
            check(times[len(times) // 10] < 2 * FRAME, 'too slow even for a busy machine')

    def phone(self):
        for dark in (False, True):
            self.browser.resize(375, 740, dark)
            self.browser.open(self.page, '#preset=box&method=newton')
            check(self.browser.run('return document.documentElement.dataset.theme') == ('dark' if dark else 'light'), 'the theme is not the system\'s')
            width = self.browser.run('return document.scrollingElement.scrollWidth')
            check(width <= 375, f'{width} px wide on a phone of 375')
        # A window that changes its size, as a phone that is turned, still shows all parts.
        for size in ((1280, 800), (375, 740), (740, 375)):
            self.browser.resize(*size)
            time.sleep(0.2)
            self.browser.idle()
            box = self.browser.run('const b = document.getElementById("view").getBoundingClientRect(); return [b.left, b.top, b.right, b.bottom]')
            for node in range(8):
                x, y = self.browser.run(f'return playground.place("node", {node})')
                check(box[0] < x < box[2] and box[1] < y < box[3], f'in a window of {size}, part {node} is at {x}, {y}, out of {box}')
        self.browser.resize(1280, 800)

    def pictures(self, folder):
        folder.mkdir(parents=True, exist_ok=True)
        for preset, method, show in (('parts', 'newton', 'path+ellipses+landscape+anchors'), ('two-minima', 'ida', 'path+ellipses+anchors'), ('hard-case', 'ncg', 'path+anchors'),
                                     ('cloth', 'lbfgs', 'path+ellipses+anchors'), ('cable', 'newton', 'path+ellipses'), ('graph', 'ncg', 'path+ellipses+anchors'),
                                     ('tracked', 'ida', 'path+ellipses+anchors'), ('weak-anchors', 'lbfgs', 'path+anchors'), ('bridge', 'newton', 'path+anchors'),
                                     ('contradiction', 'ida', 'path+ellipses+anchors'), ('one-anchor', 'ida', 'path+ellipses+anchors'),
                                     ('box', 'newton', 'path+ellipses+anchors'), ('solid', 'lbfgs', 'path')):
            for dark in (False, True):
                for width, height in ((1280, 800), (375, 1900)):
                    if preset not in ('parts', 'two-minima', 'box') and (dark or width == 375):
                        continue
                    self.browser.resize(width, height, dark)
                    self.browser.open(self.page, f'#preset={preset}&method={method}&show={show}')
                    if preset == 'two-minima':
                        self.browser.run('document.getElementById("staircase").click()')
                        time.sleep(0.2)
                    self.browser.picture(folder / f'{preset}-{"dark" if dark else "light"}-{width}.png')
        self.browser.resize(1280, 800)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('folder', type=pathlib.Path)
    parser.add_argument('native')
    parser.add_argument('--pictures', type=pathlib.Path)
    arguments = parser.parse_args()
    chromium, driver = shutil.which('chromium'), shutil.which('chromedriver')
    missing = [text for text, there in (('solver.js (emscripten)', (arguments.folder / 'solver.js').exists()), ('chromium', chromium), ('chromedriver', driver)) if not there]
    if missing:
        print(f'skipped: {", ".join(missing)} is not there')
        sys.exit(77)
    page = (arguments.folder.resolve() / 'playground.html').as_uri()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        browser = Browser(chromium, driver, pathlib.Path(folder) / 'profile')
        try:
            if arguments.pictures:
                Test(browser, page, arguments.native, pathlib.Path(folder)).pictures(arguments.pictures)
                return
            test = Test(browser, page, arguments.native, pathlib.Path(folder))
            for part in (test.presets, test.space, test.dragging, test.files_and_links, test.keyboard, test.mouse_links, test.second_minimum, test.speed, test.phone):
                part()
                check(not browser.errors(), f'{part.__name__}: errors in the console')
            print(f'{test.same} of {test.solves} results are the native ones bit for bit')
        finally:
            browser.close()


if __name__ == '__main__':
    main()
