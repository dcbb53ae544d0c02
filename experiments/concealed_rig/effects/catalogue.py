"""The effects of the catalogue, the families outside it, and those that development may see, by name."""

from experiments.concealed_rig.effects.chance import BaselineDrift, MainsHum
from experiments.concealed_rig.effects.course import AirBubble, MeniscusRefill, ThermalDrift
from experiments.concealed_rig.effects.digitiser import SensorHighpass, TimebaseError
from experiments.concealed_rig.effects.drive import AmplifierBandwidth, SlewLimit, TriggerDelay
from experiments.concealed_rig.effects.effect import Effect
from experiments.concealed_rig.effects.electronics import (
    DriveResonance,
    GeneratorSteps,
    NonlinearCapacitance,
    SupplyDroop,
)
from experiments.concealed_rig.effects.hysteresis import AsymmetricHysteresis, Creep, RateDependentHysteresis
from experiments.concealed_rig.effects.loss import CoulombFriction, SelfHeating, StructuralDamping
from experiments.concealed_rig.effects.outside_motion import Cavitation, ElectroSoftening, SpringGap
from experiments.concealed_rig.effects.outside_sensing import ClockJitter, GainWander, SensitivityByVoltage
from experiments.concealed_rig.effects.poling import Backlash, Depolarisation, VoltageDependentGain
from experiments.concealed_rig.effects.sensing import Crosstalk, Feedthrough, SensorBandwidth, SensorSaturation
from experiments.concealed_rig.effects.spring import CubicStiffness, FerroelasticSoftening, QuadraticDamping
from experiments.concealed_rig.effects.unlisted_motion import (
    AutoparametricMode,
    DomainJumps,
    OneSidedStop,
    QuadraticSpring,
    SelfExcitation,
    VolterraProduct,
    VolumeInertance,
)
from experiments.concealed_rig.effects.unlisted_sensing import (
    AutomaticGain,
    DopplerDelay,
    GainFlicker,
    LockedInterference,
    MissedAcquisition,
    NonlinearEcho,
    RectifiedPickup,
    SensorHysteresis,
)
from experiments.concealed_rig.effects.wave import SecondMode, WaveEcho


def _by_id(*effects: type[Effect]) -> dict[str, type[Effect]]:
    return {effect.id: effect for effect in effects}


CATALOGUE: dict[str, type[Effect]] = _by_id(
    AmplifierBandwidth,
    SlewLimit,
    TriggerDelay,
    DriveResonance,
    SupplyDroop,
    GeneratorSteps,
    NonlinearCapacitance,
    Creep,
    RateDependentHysteresis,
    AsymmetricHysteresis,
    Backlash,
    VoltageDependentGain,
    Depolarisation,
    CubicStiffness,
    QuadraticDamping,
    FerroelasticSoftening,
    SecondMode,
    WaveEcho,
    AirBubble,
    MeniscusRefill,
    ThermalDrift,
    CoulombFriction,
    StructuralDamping,
    SelfHeating,
    Feedthrough,
    SensorBandwidth,
    SensorSaturation,
    MainsHum,
    BaselineDrift,
    Crosstalk,
    SensorHighpass,
    TimebaseError,
)
OUTSIDE: dict[str, type[Effect]] = _by_id(
    OneSidedStop,
    SelfExcitation,
    VolumeInertance,
    QuadraticSpring,
    AutoparametricMode,
    DomainJumps,
    VolterraProduct,
    SensorHysteresis,
    GainFlicker,
    MissedAcquisition,
    DopplerDelay,
    RectifiedPickup,
    NonlinearEcho,
    LockedInterference,
    AutomaticGain,
)
DEVELOPMENT: dict[str, type[Effect]] = _by_id(
    ElectroSoftening,
    SpringGap,
    Cavitation,
    SensitivityByVoltage,
    ClockJitter,
    GainWander,
)
