"""The twenty effects of the catalogue, and the families outside it, by name."""

from experiments.concealed_rig.effects.chance import BaselineDrift, MainsHum
from experiments.concealed_rig.effects.course import AirBubble, MeniscusRefill, ThermalDrift
from experiments.concealed_rig.effects.drive import AmplifierBandwidth, SlewLimit, TriggerDelay
from experiments.concealed_rig.effects.effect import Effect
from experiments.concealed_rig.effects.hysteresis import AsymmetricHysteresis, Creep, RateDependentHysteresis
from experiments.concealed_rig.effects.outside_motion import (
    Backlash,
    Cavitation,
    CoulombFriction,
    ElectroSoftening,
    FractionalDamping,
)
from experiments.concealed_rig.effects.outside_sensing import (
    ClockJitter,
    CoarseQuantisation,
    GainWander,
    VoltageDependentGain,
)
from experiments.concealed_rig.effects.sensing import Crosstalk, Feedthrough, SensorBandwidth, SensorSaturation
from experiments.concealed_rig.effects.spring import CubicStiffness, FerroelasticSoftening, QuadraticDamping
from experiments.concealed_rig.effects.wave import SecondMode, WaveEcho

CATALOGUE: dict[str, type[Effect]] = {
    effect.id: effect
    for effect in (
        AmplifierBandwidth,
        SlewLimit,
        TriggerDelay,
        Creep,
        RateDependentHysteresis,
        AsymmetricHysteresis,
        CubicStiffness,
        QuadraticDamping,
        FerroelasticSoftening,
        SecondMode,
        WaveEcho,
        AirBubble,
        MeniscusRefill,
        ThermalDrift,
        Feedthrough,
        SensorBandwidth,
        SensorSaturation,
        MainsHum,
        BaselineDrift,
        Crosstalk,
    )
}
OUTSIDE: dict[str, type[Effect]] = {
    effect.id: effect
    for effect in (
        CoulombFriction,
        ElectroSoftening,
        FractionalDamping,
        VoltageDependentGain,
        Backlash,
        Cavitation,
        CoarseQuantisation,
        ClockJitter,
        GainWander,
    )
}
