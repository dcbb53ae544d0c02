"""Build a case: a head, a measuring plan, an effect of the strength that is asked for, and the recordings."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from experiments.concealed_rig.battery import measuring_plan
from experiments.concealed_rig.case import Case
from experiments.concealed_rig.converter import converted
from experiments.concealed_rig.effects.catalogue import CATALOGUE, DEVELOPMENT, OUTSIDE
from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.fresh import fresh_drives
from experiments.concealed_rig.head import Head, drawn_head
from experiments.concealed_rig.instruments import Instruments, drawn_instruments
from experiments.concealed_rig.location import location
from experiments.concealed_rig.measurement import Measurement
from experiments.concealed_rig.noise import noise_row
from experiments.concealed_rig.peak_cost import firing, peak_cost, peaks_V
from experiments.concealed_rig.plant import Hysteresis, Plant, Trace, trace
from experiments.concealed_rig.strength import solved_strength
from experiments.concealed_rig.tangent import BaseTangent, base_tangent
from experiments.concealed_rig.writing import write_campaign


@dataclass(frozen=True)
class Setup:
    """What is the same whatever is concealed: plan, noise, and the base plant's signals.

    Parameters
    ----------
    case : Case
    rows : list of Measurement
    base : list of Trace
    instruments : Instruments
    tangent : BaseTangent
    """

    case: Case
    rows: list[Measurement]
    base: list[Trace]
    instruments: Instruments
    tangent: BaseTangent

    def noise(self, row: Measurement) -> np.ndarray:
        """This recording's noise, shape (n,)."""
        rng = np.random.default_rng([self.case.seed, self.case.number, 100, row.order])
        # A level that grows with the signal follows the base plant's: what is concealed changes no noise.
        base = self.base[row.order - 1].signal
        return noise_row(self.instruments.noise[row.channel], base, row.step_s, rng)

    def by_chance(self, plant: Plant, row: Measurement, signal: Trace) -> np.ndarray:
        """What chance makes of this recording beyond signal and noise, shape (n,)."""
        added = np.zeros(row.drive_V.size)
        for effect in plant.effects:  # what it draws does not depend on what else there is
            rng = np.random.default_rng([self.case.seed, self.case.number, crc32(effect.id.encode()), row.order])
            added += effect.added(signal.signal, signal.slope, row, rng)
        clean = signal.signal + self.noise(row)
        recorded = clean + added
        for effect in plant.effects:
            recorded = effect.on_recorded(recorded, row)
        return recorded - clean

    def mismatches(self, plant: Plant) -> list[np.ndarray]:
        """By recording, in units of its noise, what the base model cannot absorb."""
        sigma = self.instruments.sigma
        traces = [trace(plant, row) for row in self.rows]
        raw = [
            (now.signal - base.signal) / sigma[row.channel]
            for row, now, base in zip(self.rows, traces, self.base, strict=True)
        ]
        rest = np.split(self.tangent.unexplained(np.concatenate(raw)), np.cumsum([r.size for r in raw])[:-1])
        if any(effect.by_chance for effect in plant.effects):
            rest = [
                r + self.by_chance(plant, row, now) / sigma[row.channel]
                for r, row, now in zip(rest, self.rows, traces, strict=True)
            ]
        return rest


def rms(rows: list[np.ndarray]) -> float:
    """RMS over all samples of several rows."""
    return float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))


def _setup(case: Case, head: Head) -> Setup:
    rng = case.generator("instruments")
    neighbour = bool(rng.random() < 0.5) or "crosstalk" in case.effects
    plan = case.generator("plan")
    rows = measuring_plan(head, plan, meagre=case.meagre, neighbour=neighbour, displacement=case.displacement)
    if case.slow_only:
        rows = slow_alone(rows)
    base = [trace(Plant(head), row) for row in rows]
    instruments = drawn_instruments(rows, [t.signal for t in base], case.noise_kind, rng)
    return Setup(case, rows, base, instruments, base_tangent(head, rows, instruments.sigma))


def slow_alone(rows: list[Measurement]) -> list[Measurement]:
    """The strain gauge's recordings of a plan, in their order, counted anew."""
    kept = [row for row in rows if row.channel == "strain_gauge"]
    order = {row.order: number for number, row in enumerate(kept, 1)}
    return [
        replace(row, order=order[row.order], repeat_of=None if row.repeat_of is None else order[row.repeat_of])
        for row in kept
    ]


def _situation(setup: Setup, head: Head) -> Situation:
    traces = list(zip(setup.rows, setup.base, strict=True))
    fast = [(row, t) for row, t in traces if row.channel == "self_sensing"] or traces
    return Situation(
        head=head,
        last_order=len(setup.rows),
        meagre=setup.case.meagre,
        sigma=setup.instruments.sigma,
        largest_V=max(float(np.max(np.abs(t.signal))) for _, t in fast),
        largest_deflection_V=max(t.largest_deflection_V for _, t in fast),
        largest_speed_V=max(t.largest_speed_V for _, t in fast),
        steepest_V_per_s=max(float(np.max(np.abs(np.diff(row.drive_V)))) / row.step_s for row, _ in fast),
        lowest_V=tuple(float(np.min(row.drive_V)) for row in setup.rows),
        mean_square_speed_V2=tuple(t.mean_square_speed_V2 for t in setup.base),
    )


def _planted(setup: Setup, head: Head, effect: Effect, rho: float) -> Effect:
    kind = type(effect)

    def rho_of(strength: float) -> float:
        return rms(setup.mismatches(Plant(head, (replace(effect, strength=strength),))))

    name = f"{kind.id} ({effect.variant})"
    strength = solved_strength(rho_of, rho, kind.start, kind.weakest, kind.strongest, name)
    return replace(effect, strength=strength)


def _other_law(setup: Setup, head: Head, name: str, rng: np.random.Generator) -> Hysteresis:
    scale = rng.uniform(45, 90) if name == "bouc_wen" else rng.uniform(90, 200)
    law = Hysteresis(name, 1.0, float(scale), float(rng.uniform(1.0, 2.0)), float(rng.uniform(0.5, 0.75)))
    rho = setup.case.rho
    if rho is None:
        return law

    def rho_of(share: float) -> float:
        return rms(setup.mismatches(Plant(head, (), replace(law, share=share))))

    return replace(law, share=solved_strength(rho_of, rho, 0.1, 1e-6, 1.0, name))


@dataclass(frozen=True)
class Concealed:
    """A built case: it writes its campaign, tells the truth, and answers to drives that nobody saw.

    Parameters
    ----------
    setup : Setup
    plant : Plant
        With what is concealed.
    alone : tuple of float
        Of each effect alone, the RMS of its mismatch over the noise.
    """

    setup: Setup
    plant: Plant
    alone: tuple[float, ...]

    @property
    def case(self) -> Case:
        """What was asked for."""
        return self.setup.case

    def recorded(self) -> tuple[list[np.ndarray], list[np.ndarray | None]]:
        """What the converters gave: sensors, and monitors of the drive where there are any."""
        setup, instruments = self.setup, self.setup.instruments
        sensors, monitors = [], []
        for row in setup.rows:
            now = trace(self.plant, row)
            analogue = now.signal + setup.noise(row) + setup.by_chance(self.plant, row, now)
            sensors.append(converted(analogue, instruments.converter[row.channel]))
            rng = np.random.default_rng([self.case.seed, self.case.number, 101, row.order])
            monitors.append(instruments.monitored_V(row, now.applied_V, rng))
        return sensors, monitors

    def write(self, folder: Path | str, name: str) -> None:
        """Write the campaign into a new folder; `name` goes into its descriptor.

        Raises
        ------
        ValueError
            Where the folder holds something.
        """
        sensors, monitors = self.recorded()
        write_campaign(Path(folder), name, self.setup.rows, sensors, monitors)

    def truth(self) -> dict[str, Any]:
        """What is concealed and where it shows, ready for JSON."""
        case, head, law = self.case, self.plant.head, self.plant.hysteresis
        mismatches = self.setup.mismatches(self.plant)
        reached = rms(mismatches)
        effects = [
            {
                "id": type(effect).id,
                "stage": type(effect).stage,
                "variant": effect.variant,
                "strength": effect.strength,
                "rho": alone,
                "parameters": effect.parameters(),
            }
            for effect, alone in zip(self.plant.effects, self.alone, strict=True)
        ]
        if law.law != "plays":
            numbers = {"share": law.share, "scale_V": law.scale_V}
            if law.law == "bouc_wen":
                numbers |= {"order": law.order, "beta": law.beta}
            effects.append({"id": law.law, "stage": "hysteresis", "variant": law.law, "parameters": numbers})
        return {
            "format": "concealed/1",
            "number": case.number,
            "seed": case.seed,
            "family": case.family,
            "meagre": case.meagre,
            "slow_only": case.slow_only,
            "noise": case.noise_kind,
            "effects": effects,
            "rho_asked": case.rho,
            "rho": reached,
            "detectability": reached * float(np.sqrt(sum(m.size for m in mismatches))),
            "samples": sum(m.size for m in mismatches),
            "head": {
                "a0_per_s2": head.a0_per_s2,
                "a1_per_s": head.a1_per_s,
                "b1_per_s": head.b1_per_s,
                "resonance_Hz": head.resonance_Hz,
                "damping_ratio": head.damping_ratio,
                "gauge_gain_V_per_V": head.gauge_gain_V_per_V,
                "gauge_offset_V": head.gauge_offset_V,
                "self_sensing_offset_V": head.self_sensing_offset_V,
                "reversible": head.reversible,
                "loop_V": head.loop_V,
                "density": head.density,
                "shape": list(head.shape),
            },
            "instruments": self.setup.instruments.described(),
            "location": location(self.setup.rows, mismatches),
        }

    def response(
        self, drive_V: np.ndarray, step_s: float, channel: str = "self_sensing", initial_state: str = "periodic"
    ) -> np.ndarray:
        """Noise-free sensor signal, shape (n,), of a fresh drive after the last recording; chance adds nothing.

        Parameters
        ----------
        drive_V : array_like, shape (n,)
            Linear between samples; for `periodic` one period.
        step_s : float
        channel, initial_state : str

        Raises
        ------
        ValueError
        """
        drive = np.asarray(drive_V, dtype=float)
        row = Measurement(channel, "arbitrary", initial_state, step_s, drive, order=len(self.setup.rows) + 1)
        return trace(self.plant, row).signal

    def fresh_drives(self, rng: np.random.Generator) -> list[Measurement]:
        """Drives of other shapes and amplitudes than the campaign's; see `fresh.fresh_drives`."""
        order = len(self.setup.rows) + 1
        return fresh_drives(self.plant.head, order, rng, self.case.displacement)

    def peak_cost(self, waveform: np.ndarray) -> float:
        """PeakCost(A=−5, B=5, "largest") of the seven-parameter waveform in periodic firing, peaks within 350 µs.

        Raises
        ------
        ValueError
            Where the waveform is none.
        """
        head = self.plant.head
        row = firing(waveform, head.resonance_Hz, head.damping_ratio, len(self.setup.rows) + 1)
        signal = trace(self.plant, row).signal - head.self_sensing_offset_V
        return peak_cost(peaks_V(signal, row.step_s, 2 * row.step_s))


def build(case: Case) -> Concealed:
    """Build a case.

    Parameters
    ----------
    case : Case

    Raises
    ------
    ValueError
        Where an effect cannot be as strong, or as faint, as is asked; another number draws again.
    """
    head = drawn_head(case.generator("head"))
    setup = _setup(case, head)
    rng = case.generator("effect")
    if case.family == "base":
        plant = Plant(head, (), _other_law(setup, head, case.effects[0], rng))
        return Concealed(setup, plant, ())
    kinds = {**OUTSIDE, **DEVELOPMENT} if case.family == "outside" else CATALOGUE
    situation = _situation(setup, head)
    effects: tuple[Effect, ...] = ()
    for name in case.effects:
        rho = case.rho
        if rho is None:
            raise ValueError("strength must be given where something is planted: strong, medium, faint or a number.")
        effects += (_planted(setup, head, kinds[name].drawn(situation, rng), rho),)
    alone = tuple(rms(setup.mismatches(Plant(head, (effect,)))) for effect in effects)
    return Concealed(setup, Plant(head, effects), alone)
