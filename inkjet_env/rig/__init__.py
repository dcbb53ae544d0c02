"""Virtual instruments: a measuring campaign of a head with known true parameters."""

from inkjet_env.rig.battery import (
    DriveLine,
    battery_within,
    default_battery,
    displacement_battery,
    self_sensing_battery,
    strain_gauge_battery,
)
from inkjet_env.rig.converter import Converter
from inkjet_env.rig.displacement import Vibrometer
from inkjet_env.rig.noise import Noise
from inkjet_env.rig.plan import plan_csvs
from inkjet_env.rig.record import record_campaign
from inkjet_env.rig.request import Request, Rig
from inkjet_env.rig.self_induction import SelfInduction
from inkjet_env.rig.strain_gauge import StrainGauge
from inkjet_env.rig.virtual_rig import VirtualRig

__all__ = [
    "Converter",
    "DriveLine",
    "Noise",
    "Request",
    "Rig",
    "SelfInduction",
    "StrainGauge",
    "Vibrometer",
    "VirtualRig",
    "battery_within",
    "default_battery",
    "displacement_battery",
    "plan_csvs",
    "record_campaign",
    "self_sensing_battery",
    "strain_gauge_battery",
]
