"""Verification of a certificate that a cost is nowhere below a bound; see `checking.check`.

It shares no code with what finds such certificates, nor with the simulator. Its functions are compiled at every start,
less than half a minute, so that no older version of them can be left over from before a change.
"""
