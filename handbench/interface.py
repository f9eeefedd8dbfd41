"""The public Python interface, `import handbench`: objects for captures, depth maps and scores, and
functions that do what the commands do. A library that takes long to import is imported by the call
that needs it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from handbench.bench.datasets.dataset import load_any_transform, open_capture
from handbench.bench.evaluation import score, scoring_protocols
from handbench.bench.stages.image import configured, image, prepare
from handbench.bench.validation.checks import CHANNELS, MAP, figure_warnings, on_target, warnings_of
from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.surface import Surface, read_surface
from handbench.radar.data.arrays import AntennaArray, numbers
from handbench.radar.data.capture import RadarCapture, as_complex64, fitting_unit, to_capture
from handbench.radar.data.depthmap import DepthMap, load_depthmap
from handbench.radar.data.grid import PixelGrid
from handbench.radar.methods import registry
from handbench.support.config import Config, parse, suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import free, free_folder
from handbench.support.progress import warn

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from handbench.bench.evaluation.depth_errors import ErrorMap
    from handbench.bench.results.result_folder import Result

MESHES = (".ply", ".obj", ".stl")
File = str | Path


def load(path: File) -> Capture | Depth | Surface | Transform | RunResult:
    """Read a file or folder, and return it as the object that fits its content.

    Args:
        path: a capture folder (handbench's, MAROON's, or one with a mapping.toml), a result folder,
            a depth map (.npz), a mesh (.ply, .obj, .stl; metres) or a transform (.json).

    Returns:
        A Capture, RunResult, Depth, Surface or Transform.

    Raises:
        HandbenchError: the path is none of these.
    """
    path = Path(path)
    if path.suffix == ".npz":
        return Depth(load_depthmap(path), file=path)
    if path.suffix == ".json":
        return load_any_transform(path)
    if path.suffix.lower() in MESHES:
        return read_surface(path, unscaled=True)
    if (path / "result.json").is_file():
        from handbench.bench.results.result_folder import load as load_result

        return RunResult(load_result(path))
    return Capture(path)


class Capture:
    """A recording of one scene in a folder: the radar echoes and, where there are any, photographs
    and the surface.

    Args:
        path: the folder.

    Attributes:
        name: the capture's name.
        folder: its path.
        photos: the folder of its photographs; None if there are none.
        truth: the file of the true surface, in the radar's frame; None if it is not known.
    """

    def __init__(self, path: File) -> None:
        self._recorded = open_capture(path)
        self.name = self._recorded.about.name
        self.folder = self._recorded.folder
        self.photos = self._recorded.photos
        self.truth = self._recorded.truth

    def __repr__(self) -> str:
        echoes = self.echoes
        hz = echoes.frequencies_hz
        unit_hz, unit = fitting_unit(hz.max())
        shape = " × ".join(map(str, echoes.aperture.channels))
        frames = f"{len(echoes.samples)} frame{'s' * (len(echoes.samples) > 1)}"
        tones = f"{len(hz)} tones from {hz.min() / unit_hz:.4g} to {hz.max() / unit_hz:.4g} {unit}"
        return f"<handbench.Capture {self.name}: {frames}, {tones}, {shape} channels>"

    @cached_property
    def echoes(self) -> RadarCapture:
        """The radar samples of all frames, read at the first use: `.samples` complex64 [frame,
        frequency, tx, rx], `.frequencies_hz` [frequency], and `.aperture` with the antennas `tx_m`
        [tx, 3] and `rx_m` [rx, 3] in the radar's frame."""
        return self._recorded.echoes()

    @property
    def mesh(self) -> Path | None:
        """The file of the measured surface, in the photographs' frame; None if there is none."""
        return self._recorded.mesh()

    @property
    def transform(self) -> Transform | None:
        """The transform from the photographs' frame to the radar's frame, which moves `mesh` there;
        None if there is none."""
        return self._recorded.transform()

    def reconstruct(self, method: str = "3fsk", frame: int = 0, **settings: Any) -> Depth:
        """Image one frame and find the depth of the surface at each pixel.

        Args:
            method: an id of `methods()`.
            frame: which frame, from 0.
            settings: the method's parameters, as tolerance=1e-3 or z={"step_m": 0.002}; they
                replace those that the capture's folder gives; see `handbench list methods ID`.

        Returns:
            The depth map, which remembers this capture.

        Raises:
            HandbenchError: an unknown method or parameter, a frame or a tone that the capture does
                not have.
        """
        about = self._recorded.about
        settings = _within(configured(about, method, {}), settings)
        warn(self.folder, warnings_of(self.echoes, CHANNELS))
        config = configured(about, method, settings)
        return Depth(image(self.echoes, registry.method(method), config, frame), self)


def stream(
    method: str, array: AntennaArray, frequencies_hz: ArrayLike | None = None, **settings: Any
) -> Callable[[np.ndarray], Depth]:
    """Prepare a method for frames that a radar measures one after the other.

    What depends on the geometry alone is computed with the first frame, and reused by the others.

    Args:
        method: an id of `methods()`.
        array: the antennas, as `capture.echoes.aperture`.
        frequencies_hz: the tones that are measured, in the order of the samples [tone]; by
            default, those that the method asks for, in its order.
        settings: the method's parameters, as tolerance=1e-3.

    Returns:
        A function from one frame's samples, complex [tone, tx, rx], to its depth map. The map has
        the method's own standard deviations and flags, but not p_gross.

    Raises:
        HandbenchError: an unknown method or parameter, or, from the function, samples that do not
            fit.
    """
    chosen = registry.method(method)
    config = chosen.configure(_within(chosen.defaults, settings), f"method '{method}'")
    asked_hz = config.frequencies_hz if frequencies_hz is None else np.asarray(frequencies_hz)
    begun = False

    def imaged(samples: np.ndarray) -> Depth:
        nonlocal begun
        echoes = RadarCapture(as_complex64(numbers("samples", samples))[None], asked_hz, array)
        if not begun:  # what does not change from frame to frame is checked once
            prepare(echoes, chosen, config)
            begun = True
        return Depth(chosen.run(echoes, config))

    return imaged


def _within(usual: Config, settings: dict[str, Any]) -> dict[str, Any]:
    """Complete settings of axes, as z={"step_m": 0.002}, by the `usual` ends and steps."""
    known = usual.model_dump()
    return {
        key: known[key] | value
        if isinstance(value, dict) and isinstance(known.get(key), dict)
        else value
        for key, value in settings.items()
    }


def _saved(figure: Figure, file: File | None) -> Figure:
    """Write a figure, if a file is given, and return it."""
    from handbench.reports.figures.style import save

    if file is not None:
        save(figure, file)
    return figure


class Delegating:
    """Base class of objects that also have all attributes of another, their attribute `OF`."""

    OF: str

    def __getattr__(self, name: str) -> Any:
        return getattr(vars(self).get(self.OF), name)  # None has none, while this is copied

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *dir(getattr(self, self.OF))]


class Plottable:
    """Base class of objects that `plot` draws as a figure. A notebook shows this figure for an
    object that is the result of a cell."""

    def plot(self, file: File | None = None) -> Figure:
        """Draw this object as seen from the array, so that x grows to the left.

        Args:
            file: also write the figure here (.png, .pdf, .svg); an existing file is replaced.

        Returns:
            Matplotlib's figure.
        """
        return _saved(self._figure(), file)

    def _figure(self) -> Figure:
        raise NotImplementedError

    def _repr_png_(self) -> bytes:
        from handbench.reports.figures.style import image_bytes

        return image_bytes(self._figure())


class Depth(Delegating, Plottable):
    """A depth map in the radar's frame: pixel centres x_m [nx], y_m [ny], metres; depths z_m [ny,
    nx], metres, NaN where no surface was observed; and amplitudes amplitude_db [ny, nx]. It has all
    attributes of `DepthMap`, as velocity_m_s [ny, nx] of methods that measure radial velocities,
    and save(FILE), which writes the .npz that docs/files.md describes.

    Args:
        map: the depth map as `DepthMap`.
        capture: the capture that was imaged; `evaluate` compares the map with its surface.
        file: from which the map was read.
    """

    OF = "map"

    def __init__(
        self, map: DepthMap, capture: Capture | None = None, file: File | None = None
    ) -> None:
        self.map, self.capture, self.file = map, capture, file

    def __repr__(self) -> str:
        return f"<handbench.Depth {self.method}: {on_target(self.map)}>"

    def _figure(self) -> Figure:
        from handbench.bench.results.maps import SurfaceMap
        from handbench.reports.figures.layers import depth_layers, layers_figure

        surface = SurfaceMap(self.x_m, self.y_m, self.z_m)
        velocity = {} if self.velocity_m_s is None else {"velocity_m_s": self.velocity_m_s}
        return layers_figure(depth_layers(surface, velocity), self.method)

    def points_m(self) -> np.ndarray:
        """Return the pixels with a depth as points [n, 3], metres in the radar's frame."""
        x_m, y_m = np.meshgrid(self.x_m, self.y_m)
        return np.stack([x_m, y_m, self.z_m], axis=-1)[np.isfinite(self.z_m)]

    def evaluate(
        self,
        mesh: File | None = None,
        transform: Transform | File | None = None,
        protocol: str = "paper",
    ) -> Score:
        """Compare the depth map with a surface. Without a mesh, this is the surface of the capture
        that was imaged: the true one or, if that is unknown, the measured one. Prints warnings on
        stderr.

        Args:
            mesh: a mesh file (.ply, .obj, .stl; metres).
            transform: moves the mesh into the radar's frame (an object, or its .json file); None:
                the mesh is in that frame already, or the capture has the transform of its mesh.
            protocol: which pixels are scored, and how: "paper", or "maroon", which scores the
                pixels of the capture's own mask.

        Returns:
            The metrics by name, and the map of signed errors.

        Raises:
            HandbenchError: there is no mesh, or no transform for the capture's own mesh.
        """
        recorded = self.capture._recorded if self.capture else None
        if mesh is None and recorded:
            # which is in the radar's frame already
            mesh = recorded.truth if transform is None else None
            if mesh is None and (transform := transform or recorded.transform()):
                mesh = recorded.mesh()
        if not isinstance(mesh, str | Path):
            raise HandbenchError(
                "mesh: is no path, and no capture is given with a true surface, or with a mesh and "
                "its transform; pass the path of a mesh file, or transform='radar_from_photo.json'"
            )
        if not isinstance(transform, Transform):
            transform = load_any_transform(transform)
        reference = score.reference_of_surface(
            read_surface(mesh), transform, PixelGrid(self.map.x_m, self.map.y_m)
        )
        found = score.score(self.map, reference, scoring_protocols.protocol(protocol), recorded)
        scored = Score(found.errors, found.figures, self, Path(mesh).name)
        warn(self.file or self.map.method, scored.warnings)
        return scored


class Score(dict[str, float | None], Plottable):
    """The accuracy of a depth map against a surface: a dictionary of metrics by name, as
    score["mae_mm"], and the error of each pixel; `plot` draws the surface, the map and its errors.

    Args:
        errors: signed errors in metres, z − z_ref: positive behind the surface.
        values: metric → figure in the unit that ends its name; None where it is not defined.
        depth: the depth map.
        surface: the surface's name.
    """

    def __init__(
        self, errors: ErrorMap, values: dict[str, float | None], depth: Depth, surface: str
    ) -> None:
        super().__init__(values)
        self.errors, self.depth, self.surface = errors, depth, surface
        self.warnings = [*warnings_of(depth.map, MAP), *figure_warnings(values)]

    def __missing__(self, name: str) -> NoReturn:
        raise HandbenchError(f"score: has no '{name}'; {suggest(name, list(self))}")

    def _figure(self) -> Figure:
        from handbench.reports.figures.depth_maps import methods_figure

        return methods_figure(self.surface, [(self.depth.method, self.depth.z_m, self.errors)])


class RunResult(Delegating):
    """A benchmark's result: `.table`, `.tasks`, `.scores`, `.comparisons`, … are pandas DataFrames,
    and it has all other attributes of `Result`.

    Args:
        result: the result folder as `Result`.
    """

    OF = "result"

    def __init__(self, result: Result) -> None:
        self.result = result

    def __repr__(self) -> str:
        return repr(self.result).replace("Result", "RunResult", 1)

    def plot(self, kind: str, file: File | None = None) -> Figure:
        """Draw one figure, as wide as a column of a paper, with a colour for each method.

        Args:
            kind: "captures" (MAE of each capture, and the mean), "ecdf" (distribution of |z −
                z_ref|), "frames" (MAE of each frame), "speed" (errors over the speed), "time"
                (MAE over seconds per frame) or "repeats" (scatter of the strongest scatterer).
            file: also write the figure here (.png, .pdf, .svg); an existing file is replaced.

        Returns:
            Matplotlib's figure.

        Raises:
            HandbenchError: an unknown kind, or a result without the data of this figure.
        """
        from handbench.reports.figures.plots import plot

        return _saved(plot(self.result, kind), file)


def compare(a: File | RunResult, b: File | RunResult) -> pd.DataFrame:
    """Compare two results, as `handbench compare` does: MAE, MAX, completeness, precision and time
    of every method that both have, then the other metrics that the protocol compares.

    Args:
        a, b: result folders, or results of `load` or `run`.

    Returns:
        One line for each metric, method, reference and capture; `capture` is "" for the mean over
        the captures. `a`, `b` and `difference` (B − A) are in `unit`; a mean also has its 95 %
        interval, and `p_corrected`, or in `untested` why there is no test. docs/files.md describes
        all columns.

    Raises:
        HandbenchError: the results have different scoring protocols, or no method or no reference
            in common.
    """
    from handbench.bench.results.compare_results import compare_results
    from handbench.bench.results.result_folder import load as load_result

    ours, theirs = (of.result if isinstance(of, RunResult) else load_result(of) for of in (a, b))
    return compare_results(ours, theirs).differences


def methods() -> dict[str, str]:
    """Return all imaging methods: id → one line of text that describes the method."""
    return {method.id: method.summary for method in registry.METHODS.values()}


def simulate(scene: File, folder: File, frames: int = 1, overwrite: bool = False) -> Capture:
    """Simulate the radar echoes of a scene, and the photographs if the scene has any, and write
    them as a capture.

    Args:
        scene: the scene file (.toml).
        folder: where the capture is written.
        frames: how many frames, which differ in their noise.
        overwrite: whether an existing capture may be replaced.

    Returns:
        The capture.

    Raises:
        HandbenchError: the folder exists and may not be replaced, or is not a capture.
    """
    from handbench.bench.datasets.simulated import WRITTEN, simulate_capture
    from handbench.bench.scenes.build import load_scene

    free_folder(Path(folder), overwrite, WRITTEN)
    simulate_capture(load_scene(scene), folder, frames)
    return Capture(folder)


def save_capture(
    folder: File,
    samples: ArrayLike,
    frequencies_hz: ArrayLike,
    tx_m: ArrayLike | None = None,
    rx_m: ArrayLike | None = None,
    *,
    position_m: ArrayLike | None = None,
    pairs: ArrayLike | None = None,
    times_s: ArrayLike | None = None,
    frame_times_s: ArrayLike | None = None,
    wave_speed_m_s: float = 299_792_458.0,
    **description: Any,
) -> Capture:
    """Write echoes, however they were measured, as a capture folder.

    Args:
        folder: the new folder.
        samples: complex [frame, frequency, tx, rx], or [frame, frequency, pair] with `pairs`, or
            [frame, frequency, position] with `position_m`. An echo is exp(−j2πf·path/c): conjugate
            samples of the other sign. A channel that was not measured is NaN throughout.
        frequencies_hz: the tones [frequency].
        tx_m, rx_m: positions [n, 3] of the transmitters and receivers in the radar's frame, metres.
        position_m: instead of these, the places [position, 3] of a transceiver that is moved.
        pairs: indices [pair, 2] of the transmitter and the receiver of each channel, from 0.
        times_s: when each tone of a frame was measured [frequency]; frame_times_s: when each frame
            was [frame].
        wave_speed_m_s: of a medium.
        description: keys of capture.toml, as kind="other", distance_m=0.3, methods={...}.

    Returns:
        The capture.

    Raises:
        HandbenchError: the folder exists, or the shapes do not fit together.
    """
    from handbench.bench.datasets.native import save_echoes_folder

    free(False, Path(folder))
    scan = position_m is not None
    if {tx_m is None, rx_m is None} != {scan} or (scan and pairs is not None):
        raise HandbenchError(
            "tx_m, rx_m: expected both, perhaps with pairs, or position_m of a scan instead"
        )
    antennas = {"position_m": position_m} if scan else {"tx_m": tx_m, "rx_m": rx_m}
    capture = to_capture(
        np.atleast_1d(samples),
        np.atleast_1d(frequencies_hz),
        {name: numbers(name, places_m) for name, places_m in antennas.items()},
        None if pairs is None else numbers("pairs", pairs),
        times_s=times_s,
        frame_times_s=frame_times_s,
        wave_speed_m_s=wave_speed_m_s,
    )
    save_echoes_folder(folder, capture, description)
    return Capture(folder)


def reconstruct_mesh(
    photos: File, mesh: File | None = None, workdir: File | None = None, **options: Any
) -> Surface:
    """Reconstruct a surface in metres from photographs, by photogrammetry.

    Args:
        photos: the folder of photographs.
        mesh: also write the surface here (.ply).
        workdir: keep intermediate files here, cameras and sparse points among them.
        options: fields of `handbench.groundtruth.options.Options`, as board="board.toml",
            quality="draft".

    Returns:
        The surface in the photographs' frame: `vertices_m` [n, 3], `faces` [m, 3], `sigma_m` [n],
        the standard deviation along the normal, and `observed` [n], False for a vertex that was
        interpolated.
    """
    from handbench.groundtruth.options import Options
    from handbench.groundtruth.pipeline import reconstruct

    found = reconstruct(
        Path(photos), parse(Options, options, "groundtruth"), Path(workdir) if workdir else None
    )
    if mesh is not None:
        found.surface.save(mesh)
    return found.surface


def calibrate(captures: File | Sequence[File], quality: str = "draft", seed: int = 0) -> Transform:
    """Compute the transform from the photographs' frame to the radar's frame, from captures of a
    calibration target that both sensors see.

    Args:
        captures: one or several captures of the same target.
        quality: of the photogrammetry: draft, normal or high.
        seed: of the random numbers.

    Returns:
        The transform, with the covariance of [translation in metres, rotation vector in radians].
    """
    from handbench.bench.stages.calibrate import calibrate_captures

    named = [captures] if isinstance(captures, str | Path) else captures
    return calibrate_captures([*map(Path, named)], quality, seed)


def run(bench: File, folder: File, overwrite: bool = False) -> RunResult:
    """Run a benchmark: image every capture with every method and score the depth maps. A run that
    was interrupted is resumed.

    Args:
        bench: the benchmark's .toml, or the name of one that handbench contains, as "paper_table",
            or a folder of captures, which the paper's four methods image.
        folder: where the result is written.
        overwrite: whether another benchmark's result may be replaced.

    Returns:
        The result, whose tables `.table`, `.tasks`, `.comparisons`, … are pandas DataFrames.
    """
    from handbench.bench.benchmarks.benchmark_file import load_benchmark
    from handbench.bench.run import runner

    return RunResult(runner.run(*load_benchmark(str(bench)), Path(folder), overwrite))
