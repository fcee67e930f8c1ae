"""Maps from the store: what identifies a map, and what only its caller adds."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from llvmlite import binding
from numpy.typing import NDArray

from ambinav.ambiguity.model import AmbiguityModel
from ambinav.config import check_kind
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.content_digest import environment_digest
from ambinav.runtime.progress import Progress
from ambinav.runtime.provenance import PACKAGES, Provenance, digest_of
from ambinav.sensing.scanner import RangeScanner
from ambinav.store.map_store import MapStore


def computing_digest() -> str:
    """Return a digest of what computes here: code, libraries, and the kind of processor."""
    return digest_of(Provenance.here().digest, binding.get_host_cpu_name())


def map_key(
    env: Environment,
    scanner: RangeScanner,
    thinned: RangeScanner,
    model: AmbiguityModel,
    spacing: float,
    theta: NDArray[Any] | None,
    layers: Iterable[str],
) -> str | None:
    """Return a key that is equal only for maps with the same computation.

    It is made of the environment's content, whatever its name and place; of the scanner, the
    parameters and the layers; of all of ambinav's code and the versions of the libraries that
    decide numbers; and of the kind of processor, for which kernels are compiled.

    Args:
        env: The building.
        scanner: The scanner.
        thinned: Its beams that take part.
        model: Parameters.
        spacing: Spacing of the lattice, metres.
        theta: Headings, radians; None: one represents all.
        layers: Names of further layers.

    Returns:
        32 hexadecimal digits; None where code from elsewhere takes part (a plug-in's layer, a
        derived class), of which nobody knows when it changes.
    """
    from ambinav.layers.registry import LAYERS

    names = tuple(layers)
    parts: list[object] = [env, scanner, *scanner.parts]
    if env.space is not None:
        parts.append(env.space)
    for part in scanner.parts:
        parts += [part.sensor, part.layout]
    modules = [type(part).__module__ for part in parts]
    modules += [getattr(LAYERS.get(name).compute, "__module__", "") for name in names]
    if any(module.partition(".")[0] not in PACKAGES for module in modules):
        return None
    computed_by = (Provenance.here().digest, binding.get_host_cpu_name())
    made_of = (environment_digest(env), scanner, thinned, model, spacing, theta, names)
    return digest_of(computed_by, made_of)[:32]


def opened_or_computed(
    key: str | None,
    labels: dict[str, str],
    compute: Callable[[Progress], AmbiguityMap],
    report: Progress,
    store: MapStore | None,
) -> AmbiguityMap:
    """Open a map from a store, or compute and store it.

    Args:
        key: See `map_key`.
        labels: Attributes of the map that are this caller's, whoever computed it.
        compute: Computes the map; takes what is called with the share done.
        report: Called with the share done.
        store: The store; None: the user's own.

    Raises:
        InputError: see `MapStore.of_user`.
    """
    if store is None:
        store = MapStore.of_user()
    check_kind(store, MapStore, "store", "give True, False or a MapStore of a folder")

    def build(alive: Callable[[], None]) -> AmbiguityMap:
        def report_progress(share: float) -> None:
            alive()
            report(share)

        return compute(report_progress)

    amap, opened = store.opened_or_built(key, build)
    if opened:
        amap.dataset.attrs |= labels
        if key is not None:
            store.note_opened(key, amap)
        report(1.0)
    return amap
