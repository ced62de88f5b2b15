#!/usr/bin/env python3
"""Wrong arguments to every public function and method: an error of one line that says what is wrong, in the words of this library."""

import inspect
import os
import re
import tempfile
import unittest
import warnings

import asterism
import numpy as np
from asterism import pose
from moving_square import BOX, draw_frame

random = np.random.default_rng(1)
POINTS = random.uniform(0, 10, (6, 2))
DISTANCES = np.linalg.norm(POINTS[:, None] - POINTS, axis=2)
TOPOLOGY = asterism.Topology.full(6)
EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (3, 4)]
MAP, STACK, JOINTS = random.uniform(0, 9, (5, 6)), random.uniform(0, 9, (2, 5, 6)), [asterism.Joint(0, 1)]
BEACONS = np.array([[0, 0], [10, 0], [0, 10], [9, 9.0]])
FOLDER = tempfile.TemporaryDirectory()
FILE = os.path.join(FOLDER.name, "file")
os.chdir(FOLDER.name)  # where files of strange names are written


def spring_system():
    system = asterism.SpringSystem(TOPOLOGY)
    system.anchors, system.anchor_stiffness, system.link_stiffness = POINTS, 1, 2
    system.set_rest_lengths(POINTS)
    return system


def spring_batch():
    batch = asterism.SpringBatch(TOPOLOGY, 2)
    for name in ("anchors", "anchor_stiffness", "rest_length", "link_stiffness"):
        setattr(batch, name, getattr(spring_system(), name))
    batch.x = POINTS
    return batch


def term_system(has_common_length=True):
    system = asterism.System(6)
    system.add_anchors(POINTS, np.ones(6))
    system.add_links([[0, 1], [1, 2]], 3, offsets=[[3, 0], [3, 0]])
    if has_common_length:
        system.add_common_length([[0, 1], [1, 2]])
    return system


def solution():
    system, x = asterism.System(6), POINTS.copy()
    system.add_anchors(POINTS)
    system.solve(x)
    return system.solution(x)


def stream():
    path = asterism.PathStream(shortest=0.1)
    path.move(1, 0, 0.1)
    return path


def arguments(**all_of_them):
    return all_of_them


def of_name(name, make=None, /, **valid):
    """make() gives the function: for methods, that of a new object."""
    return name, (make or (lambda: getattr(asterism, name)), valid)


LOSS = arguments(stiffness=1, loss="huber", scale=1.0, sharpness=None)
LAW = arguments(law="hooke", upper=None, offsets=None, information=None, convex_in_square=False)
STEPS = np.tile([1.0, 0, 0.1], (19, 1))
CAMERAS = [pose.Camera([[100, 0, 50], [0, 100, 50], [0, 0, 1]], [0, turn, 0], [0, 0, 5]) for turn in (0, 0.5)]
SPACE = random.uniform(-1, 1, (30, 5, 3))
SEEN = np.stack([camera.project(SPACE) for camera in CAMERAS])
IMAGE_PATHS = np.cumsum(random.normal(0, 1, (1, 30, 5, 2)), axis=1)
FUSED = pose.fuse(SEEN, cameras=CAMERAS)
NAMES = ["left_a", "right_a", "b", "c", "d"]
pose.write_points(FILE + ".csv", IMAGE_PATHS[0], NAMES)

CALLS = dict(
    [
        of_name("Topology.full", lambda: asterism.Topology.full, nodes=4),
        of_name("Topology.star", lambda: asterism.Topology.star, nodes=4, centre=0),
        of_name("Topology.k_nearest", lambda: asterism.Topology.k_nearest, points=POINTS, k=2),
        of_name("Topology.from_links", lambda: asterism.Topology.from_links, nodes=4, links=[[0, 1], [1, 2]]),
        of_name("random_system", kind="lit", nodes=5, seed=1, dim=2),
        of_name("SpringSystem", topology=TOPOLOGY, dim=2),
        *(of_name(f"SpringSystem.{f}", lambda f=f: getattr(spring_system(), f), points=POINTS) for f in ("set_rest_lengths", "set_rest_offsets")),
        *(of_name(f"SpringSystem.{f}", lambda f=f: getattr(spring_system(), f), node=1) for f in ("fix", "release", "is_fixed")),
        *(
            of_name(f, system=spring_system(), x=POINTS)
            for f in ("energy", "gradient", "hessian", "sparse_hessian", "stationarity", "covariance", "node_covariances")
        ),
        of_name("certify", system=spring_system(), x=POINTS, gap=1e-6),
        of_name("sensitivity", system=spring_system(), x=POINTS, grad_x=POINTS, stationarity=1e-6),
        of_name(
            "solution_tangent", system=spring_system(), x=POINTS, anchors=POINTS, anchor_stiffness=np.ones(6), rest_length=np.ones(15),
            link_stiffness=np.ones(15), stationarity=1e-6,
        ),
        of_name("Solver", method="newton", tolerance=1e-6, max_iterations=10),
        of_name("Solver.solve", lambda: asterism.Solver().solve, system=spring_system(), x=POINTS.copy(), on_iteration=None, check=True),
        of_name("solve", system=spring_system(), x=POINTS.copy(), method="newton", on_iteration=None, check=True, tolerance=1e-6),
        of_name(
            "add_link_law", lambda: lambda name, **rest: asterism.add_link_law(f"{name}{random.random()}" if isinstance(name, str) else name, **rest),
            name="own", function=lambda r, mu: ((r - mu) ** 2, 2 * (r - mu), 2 + 0 * r), convex_in_square=False,
        ),
        of_name("System", nodes=3, dim=2),
        *(of_name(f"System.{f}", lambda f=f: getattr(term_system(), f), node=1) for f in ("fix", "unfix", "is_fixed")),
        of_name("System.add_nodes", lambda: term_system().add_nodes, count=2),
        of_name("System.remove_nodes", lambda: term_system().remove_nodes, nodes=[1]),
        of_name("System.add_anchors", lambda: asterism.System(6).add_anchors, positions=POINTS, nodes=range(6), information=None, **LOSS),
        of_name("System.add_offsets", lambda: asterism.System(6).add_offsets, pairs=[[0, 1]], offsets=[[1, 2]], information=None, **LOSS),
        of_name(
            "System.add_differences", lambda: asterism.System(6).add_differences, triples=[[0, 1, 2]], target=0, coefficients=(1, -2, 1),
            information=None, **LOSS,
        ),
        of_name("System.add_links", lambda: asterism.System(6).add_links, pairs=[[0, 1]], lengths=1, **LAW, **LOSS),
        of_name("System.add_bendings", lambda: asterism.System(6).add_bendings, triples=[[0, 1, 2]], lengths=1, **LAW, **LOSS),
        of_name("System.add_angles", lambda: asterism.System(6).add_angles, triples=[[0, 1, 2]], angles=1, **LOSS),
        of_name("System.add_areas", lambda: asterism.System(6).add_areas, triples=[[0, 1, 2]], areas=1, **LOSS),
        of_name(
            "System.add_common_length", lambda: asterism.System(6).add_common_length, pairs=[[0, 1], [1, 2]], lengths=0, prior=0,
            prior_stiffness=0, **LOSS,
        ),
        of_name("System.add_loads", lambda: asterism.System(6).add_loads, forces=POINTS, nodes=range(6)),
        of_name(
            "System.add_elements", lambda: asterism.System(6).add_elements, nodes=[[0, 1]], has_hessian=False,
            function=lambda points: ((points**2).sum((1, 2)), 2 * points),
        ),
        *(of_name(f"System.{f}", lambda f=f: getattr(term_system(), f), x=POINTS) for f in ("energy", "gradient", "stationarity")),
        of_name("System.solution", lambda: (lambda system: (system.add_anchors(POINTS), system.solution)[1])(asterism.System(6)), x=POINTS),
        of_name("System.solve", lambda: term_system().solve, x=POINTS.copy(), method="auto", on_iteration=None, check=True, max_iterations=9),
        of_name(
            "System.solve_turning", lambda: term_system(False).solve_turning, x=POINTS.copy(), scale=True, tolerance=1e-8, max_iterations=9,
            hold_floating=False, check=True,
        ),
        of_name("System.certify", lambda: term_system().certify, x=POINTS, gap=1e-6),
        of_name("System.remove", lambda: (lambda system: lambda term: system.remove(system.terms[0] if term is None else term))(term_system()), term=None),
        of_name("Term.append", lambda: term_system().terms[0].append, nodes=[1, 2], position=POINTS[:2], stiffness=1),
        of_name("Term.remove", lambda: term_system().terms[0].remove, elements=[1]),
        of_name("Term.estimate", lambda: term_system().terms[2].estimate, x=POINTS),
        of_name("Solution.covariance", lambda: solution().covariance, node=0),
        of_name("Solution.gradients", lambda: solution().gradients, by_x=POINTS),
        of_name("SpringBatch", topology=TOPOLOGY, count=2, dim=2),
        of_name(
            "SpringBatch.solve", lambda: spring_batch().solve, threads=1, simd="auto", tolerance=1e-8, max_iterations=9, align=True,
            allow_reflection=False, escape_saddles=True, gap=0.0,
        ),
        of_name("SpringBatch.sensitivity", lambda: spring_batch().sensitivity, grad_x=np.ones((2, 6, 2)), stationarity=1e-6, threads=1, simd="auto"),
        of_name(
            "PathStream", shortest=0.1, start=[0, 0, 0], start_sigma=[1, 1], window=100, cutoff=None, turn_sigma=0.003, step_sigma=0.1, settle_every=9
        ),
        of_name("PathStream.move", lambda: stream().move, x=1.0, y=0.0, turn=0.1),
        of_name("PathStream.range", lambda: stream().range, beacon=[1, 2], range=3.0, sigma=1.0),
        of_name(
            "mds", distances=DISTANCES, weights=np.ones((6, 6)), anchors=POINTS, dim=2, anchor_weights=1.0, start=POINTS, method="multi-start",
            max_iterations=9,
        ),
        of_name(
            "MDS", lambda: lambda **given: asterism.MDS(**given).fit(DISTANCES), n_components=2, metric=True, n_init=1, max_iter=9, eps=1e-3,
            n_jobs=1, random_state=0, dissimilarity="precomputed", normalized_stress=False, loss="huber", scale=1.0, certify=False,
        ),
        *(of_name(f"MDS.{f}", lambda f=f: getattr(asterism.MDS(n_init=1, max_iter=9), f), X=POINTS, init=POINTS) for f in ("fit", "fit_transform")),
        of_name("MDS.transform", lambda: asterism.MDS(n_init=1, max_iter=9).fit(POINTS).transform, X=POINTS),
        of_name(
            "layout", graph=EDGES, dim=2, power=2.0, partners=None, anchors=POINTS[:5], anchor_weights=1.0, start=POINTS[:5], method="newton",
            length="length", sizes=None, layers=None, downward=None, aligned=None, groups=None, max_iterations=9,
        ),
        of_name(
            "layout, rules", lambda: lambda **given: asterism.layout(EDGES, **given), sizes=np.ones((5, 2)), layers=[0, 1, 2, 1, 2], downward=None,
            aligned=[("x", [0, 1])], groups=[[0, 1]],
        ),
        of_name("layout_stress", graph=EDGES, x=POINTS[:5], power=2.0, scaled=False, length="length"),
        of_name("remove_overlaps", x=POINTS, sizes=np.ones((6, 2)), held=np.zeros(6, bool)),
        of_name("locate", beacons=BEACONS, ranges=np.full(4, 7.0), sigma=1.0, cutoff=3.0, within=5.0, max_cells=1000, threads=1),
        of_name("survey", ranges=DISTANCES, sigma=0.1, bias=0.1, dim=2),
        of_name(
            "locate_path", steps=STEPS, beacons=BEACONS, pose=np.arange(20), beacon=np.arange(20) % 4, ranges=np.full(20, 9.0), sigma=1.0, times=None,
            cutoff=3.0, turn_sigma=0.003, step_sigma=0.1, shortest=0.1, start=[0, 0, 0], start_sigma=[1, 1], lower_bound=True, max_iterations=9,
        ),
        *(of_name(f, maps=[MAP, MAP], joints=JOINTS, count=2, distance=0.0) for f in ("pictorial_structure", "m_best_placements")),
        of_name("loopy_structure", maps=[MAP, MAP], joints=JOINTS, tolerance=1e-3, progress=0.01, max_iterations=9),
        of_name("scaled_structure", maps=[STACK, STACK], joints=JOINTS, scales=[1.0, 2.0], count=1, distance=0.0),
        of_name(
            "Joint", lambda: lambda **given: asterism.scaled_structure([STACK, STACK], [asterism.Joint(**given)], [1, 2]), parent=0, child=1,
            offset=(0, 0), weight=1.0, shape="quadratic", truncation=9.0, length=None, reach=8, layer_weight=1.0,
        ),
        of_name(
            "bench.compare", lambda: asterism.bench.compare, solver=lambda problem: problem.start, name="m", kinds=["lit"], sizes=[2], systems=1,
            dim=2, against=[], tolerance=1e-8, gap=1e-6, first_seed=0, proof_seconds=0.01,
        ),
        of_name("pose.fuse", lambda: pose.fuse, detections=SEEN, confidence=np.ones((2, 30, 5)), cameras=CAMERAS, skeleton=[(0, 1)], times=np.arange(30.0)),
        of_name("pose.fuse, pairs", lambda: pose.fuse, detections=IMAGE_PATHS, pairs=[(0, 1)], deviation=np.ones((1, 30, 5))),
        of_name(
            "pose.Camera", lambda: lambda **given: pose.Camera(**given).project(SPACE), matrix=np.diag([9.0, 9, 1]), rotation=[0, 0, 0],
            translation=[0, 0, 5], distortions=(0, 0), size=(9, 9), name="a",
        ),
        of_name("pose.Camera.project", lambda: CAMERAS[0].project, points=SPACE),
        of_name("pose.Camera.undistort", lambda: CAMERAS[0].undistort, pixels=IMAGE_PATHS),
        of_name("pose.Stream", lambda: pose.Stream, recorded=FUSED, cameras=CAMERAS, window=12),
        of_name("pose.Stream.push", lambda: pose.Stream(FUSED, CAMERAS).push, detections=SEEN[:, 0], time=31.0, confidence=np.ones((2, 5))),
        of_name("pose.exchange_back", lambda: pose.exchange_back, detections=IMAGE_PATHS, pairs=[(0, 1)], times=np.arange(30.0)),
        of_name("pose.Exchanged.apply", lambda: pose.exchange_back(IMAGE_PATHS, [(0, 1)]).apply, values=IMAGE_PATHS, pairs=[(0, 1)]),
        of_name("pose.left_right_pairs", lambda: pose.left_right_pairs, names=NAMES),
        of_name("pose.network_deviation", lambda: pose.network_deviation, networks=IMAGE_PATHS + random.normal(size=(3, 1, 30, 5, 2))),
        of_name("pose.write_points", lambda: pose.write_points, path=FILE, points=IMAGE_PATHS[0], joints=NAMES, frames=None, confidence=None),
        of_name("pose.read_detections", lambda: pose.read_detections, path=FILE + ".csv"),
    ]
)
if hasattr(asterism, "read_systems"):
    asterism.write_systems(FILE + ".json", [asterism.StoredSystem(spring_system(), POINTS)])
    CALLS |= dict(
        [
            of_name("read_systems", path=FILE + ".json"),
            of_name("parse_systems", text=open(FILE + ".json").read(), source="text"),
            of_name("write_systems", path=FILE, systems=[asterism.StoredSystem(spring_system(), POINTS)]),
            of_name(
                "StoredSystem", lambda: lambda **given: asterism.write_systems(FILE, [asterism.StoredSystem(**given)]), system=spring_system(),
                start=POINTS, name="a", origin={},
            ),
        ]
    )
if hasattr(asterism, "Tracker"):
    FRAME = draw_frame(0)

    def started(make):
        tracker = make("kcf")
        tracker.init(FRAME, BOX)
        return tracker

    def several():
        trackers = asterism.MultiTracker()
        trackers.add(1, FRAME, BOX, "kcf")
        return trackers

    RESULTS = [started(asterism.Tracker).update(FRAME)] * 3
    CALLS |= dict(
        [
            of_name("Tracker", name="kcf", options={}, pixel_range=(0, 255)),
            of_name("Tracker.init", lambda: asterism.Tracker("kcf").init, image=FRAME, box=BOX),
            of_name("Tracker.update", lambda: started(asterism.Tracker).update, image=FRAME),
            of_name("Tracker.restore", lambda: asterism.Tracker("kcf").restore, state=started(asterism.Tracker).save()),
            of_name("OpenCvTracker", name="kcf", options={}),
            of_name("OpenCvTracker.init", lambda: asterism.OpenCvTracker("kcf").init, image=FRAME, boundingBox=BOX),
            of_name("OpenCvTracker.update", lambda: started(asterism.OpenCvTracker).update, image=FRAME),
            of_name("MultiTracker", threads=1, pixel_range=(0, 255)),
            of_name("MultiTracker.add", lambda: asterism.MultiTracker().add, id=1, image=FRAME, box=BOX, name="kcf", options={}),
            of_name("MultiTracker.remove", lambda: several().remove, id=1),
            of_name("MultiTracker.update", lambda: several().update, image=FRAME),
            of_name("TrackResult.corners", lambda: RESULTS[0].corners, part=None),
            of_name("tracker_options", name="kcf", options={}),
            of_name("suggested_range", image=FRAME),
            of_name("smooth_track", box=BOX, results=RESULTS, shape=FRAME.shape),
            *([of_name("part_options", name=asterism.part_names()[0])] if hasattr(asterism, "part_options") else []),
        ]
    )

# Of results, which nobody makes, and without arguments; what is tested elsewhere.
NOT_HERE = re.compile(
    r"^Topology$|copy$|OpenCvTracker\.create|pose\.read_cameras|evaluat|Embedding|Sensitivity|(Pictorial|Scaled|Loopy)Result|Survey$|PathEstimate|PositionFix|PositionMinimum"
    r"|Status|Summary|Certificate|PartState|TrackResult$|Term$|Solution$|pose\.(FusedPose|Detections|StreamedPose|Exchanged)$|bench\.(Comparison|Row|Problem)"
    r"|methods$|_names$|settle$|batch$|save$|options$|get_(params|feature_names_out)$|set_(params|output)$|as_dict$"
)


class Strange:
    def __repr__(self):
        raise RuntimeError("no repr")


def read_only():
    values = POINTS.copy()
    values.flags.writeable = False
    return values


STRANGE = [
    *(None, "text", b"bytes", 3, -1, 0, 2**40, 10**30, 1.5, np.nan, np.inf, -np.inf, True, 1e308, 1e-320, 1j, Strange(), lambda *_: None),
    *([], [[]], {}, {1, 2}, (1, 2), [[1, 2], [3]], [None], ["a", "b"], [np.nan, np.nan], [[0, 99], [0, 0]], [[-1, 0]]),
    *(np.int64(2), np.float32(1.5), np.array(3.0), np.zeros(0), np.zeros((0, 2)), np.arange(6), -np.ones(6), np.ones(7), np.ones((7, 2))),
    *(np.full((6, 2), np.nan), np.full((6, 2), np.inf), np.ones((6, 2, 2)), np.ones((2, 3, 4, 5)), POINTS[::-1], POINTS.astype("f4"), read_only()),
    *(np.full((6, 2), None), np.array(["a"] * 6), np.array(["2020-01-01"] * 6, "M8[D]"), np.ma.masked_array(POINTS, POINTS > 5)),
]
# What a compiler, pybind11, Python or NumPy would say, and nobody understands.
RAW = re.compile(
    r"incompatible|Unable to cast|std::|pybind|basic_string|0x[0-9a-f]{6}|ambiguous|ufunc|unsized|not iterable|unhashable"
    r"|not supported between|could not (convert|be promoted)|NoneType' object|has no attribute|cannot convert|out of bounds|only size-1|Singular matrix"
)
REFUSALS = (TypeError, ValueError, IndexError, KeyError, OSError, RuntimeError, np.linalg.LinAlgError)


def public_callables():
    for place, module in (("", asterism), ("pose.", pose), ("bench.", asterism.bench), ("evaluation.", asterism.evaluation)):
        for name in module.__all__:
            thing = getattr(module, name)
            if callable(thing):
                yield place + name, thing
            if inspect.isclass(thing):
                for member in vars(thing):
                    if not member.startswith("_") and callable(getattr(thing, member)):
                        yield f"{place}{name}.{member}", getattr(thing, member)


class ArgumentsTest(unittest.TestCase):
    def assert_clear(self, error, *where):
        text = str(error)
        if text.startswith(("expected str, bytes or os.PathLike", "argument should be a str object")):
            return  # Python's own, of a path
        with self.subTest(where, text=text[:300]):
            self.assertIsInstance(error, REFUSALS)
            self.assertEqual(len(text.splitlines()), 1)
            self.assertNotRegex(text, RAW)

    def test_every_public_callable_is_here(self):
        names = {name for name, _ in public_callables()}
        self.assertGreater(len(names), 100)
        self.assertEqual({name for name in names - set(CALLS) if not NOT_HERE.search(name)}, set())

    def test_wrong_values(self):
        calls = refusals = 0
        for name, (make, valid) in CALLS.items():
            with self.subTest(name, arguments="valid ones"):
                make()(**valid)
            for argument in valid:
                for value in STRANGE:
                    calls += 1
                    with warnings.catch_warnings():
                        warnings.simplefilter("error")
                        warnings.simplefilter("ignore", UserWarning)  # of layout, on nodes without edges
                        try:
                            make()(**{**valid, argument: value})
                        except Exception as error:
                            refusals += 1
                            self.assert_clear(error, name, argument, type(value))
        self.assertGreater(calls, 5000)
        self.assertGreater(refusals, calls // 2)

    def test_wrong_numbers_and_names_of_arguments(self):
        for name, function in public_callables():
            for given, named in (([object()] * 20, {}), ([], {"no_such_argument": 1})):
                if name == "MDS":  # says so in fit, as estimators do
                    continue
                try:
                    function(*given, **named)
                except Exception as error:
                    self.assert_clear(error, name, len(given))
                else:
                    self.assertRegex(name, "Solver|Comparison|Embedding|Survey|Result|PathEstimate|Joint|Row|Problem|StoredSystem|Position|Sensitivity", name)

    def test_messages(self):
        full, system = asterism.Topology.full, term_system()
        for call, kind, message in (
            (lambda: full(3.0), TypeError, "nodes: expected an integer, found 3.0"),
            (lambda: full("3"), TypeError, "nodes: expected an integer, found '3'"),
            (lambda: full(2**40), ValueError, "nodes: 1099511627776 is out of range"),
            (lambda: asterism.mds([[0, 1], [1, 0]], seed=-1), ValueError, "option seed: expected an integer from 0 to 18446744073709551615, found -1"),
            (lambda: asterism.mds([[0, 1], [1, 0]], seed=0.5), TypeError, "option seed: expected an integer, found 0.5"),
            (lambda: asterism.mds([[0, 1], [1, 0]], max_iterations=2**40), ValueError, "option max_iterations: expected an integer from -2147483648 to 2147483647, found 1099511627776"),
            (lambda: full(), TypeError, "full() needs 'nodes' (it has: nodes)"),
            (lambda: full(3, 4), TypeError, "full() takes 1 argument without a name, found 2 (it has: nodes)"),
            (lambda: full(n=3), TypeError, "full() has no option 'n' (it has: nodes)"),
            (lambda: full(3, nodes=3), TypeError, "full() is given 'nodes' twice"),
            (lambda: asterism.SpringSystem(3), TypeError, "topology: expected asterism.Topology, found 3; Topology.full(4) links all pairs of four nodes, Topology.from_links(4, [(0, 1)]) those listed"),
            (lambda: asterism.Topology(4), TypeError, "asterism.Topology: use Topology.full(nodes) for all pairs, or Topology.from_links(nodes, pairs), .star or .k_nearest"),
            (lambda: asterism.System(3).add_links([(0, 1)], 1, loss="huber", delta=1), TypeError, "System.add_links() has no option 'delta': here it is 'scale', of the loss (it has: pairs, lengths, stiffness, law, upper, offsets, information, convex_in_square, loss, scale, sharpness)"),
            (lambda: asterism.SpringSystem(TOPOLOGY, ndim=3), TypeError, "SpringSystem() has no option 'ndim': here it is 'dim', 2 or 3 (it has: topology, dim)"),
            (lambda: system.fix(1.5), TypeError, "node: expected an integer, found 1.5"),
            (lambda: system.fix(), TypeError, "System.fix() needs 'node' (it has: node)"),
            (lambda: asterism.System.fix(3, 1), TypeError, "self: expected asterism.System, found 3"),
            (
                lambda: asterism.energy(system, POINTS),
                TypeError,
                "system: expected asterism.SpringSystem, found System; a System has methods, such as system.solve(x) and system.solution(x).covariance(node)",
            ),
            (lambda: asterism.PathStream(shortest=1, start=[1, 2]), ValueError, "start: expected shape (3,), found (2,)"),
            (lambda: asterism.locate(BEACONS, [1, 2, 3, 4], 1, threads=None), TypeError, "threads: expected an integer, found None"),
            (lambda: asterism.certify(spring_system(), POINTS, gap=[1] * 99), TypeError, "gap: expected a number, found list"),
            (lambda: asterism.Solver(tolerance=np.ones((2, 3))), TypeError, "option tolerance: expected a number, found ndarray"),
        ):
            with self.subTest(message), self.assertRaises(kind) as raised:
                call()
            self.assertEqual(str(raised.exception), message)

    def test_errors_of_ones_own_functions_stay_as_they_are(self):
        def stop(*_):
            raise TypeError("energy(): incompatible with my taste")

        with self.assertRaisesRegex(TypeError, "^energy\\(\\): incompatible with my taste$"):
            asterism.solve(spring_system(), POINTS + 3, "newton", on_iteration=stop)


if __name__ == "__main__":
    unittest.main()
