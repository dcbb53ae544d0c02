"""Effects that most of these diagnoses look for, and the ids of those that one names."""

LOOKED_FOR = ("cubic_stiffness", "quadratic_damping", "feedthrough", "sensor_bandwidth", "amplifier_bandwidth",
              "mains_hum", "baseline_drift")  # fmt: skip


def ids(diagnosis):
    return [named.effect.id for named in diagnosis.effects]
