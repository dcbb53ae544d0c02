"""The refusal of an identification: recordings that do not determine a head."""


class UnidentifiableError(ValueError):
    """Recordings from which no head can be identified; the message says what they lack, or which sensor is silent."""


class NothingRingsError(UnidentifiableError):
    """A model without a resonance explains the recordings equally well, or the best resonance is impossible."""
