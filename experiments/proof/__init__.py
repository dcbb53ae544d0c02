"""A blind proof of the diagnosis: effects concealed, sealed, diagnosed from recordings alone, unsealed, scored.

`corpus` defines the cases; `concealment` has an independent plant record them; `sealing` commits to the truth;
`blind_run` and `sandbox` run ``inkjet diagnose`` on one campaign; `judge` compares a verdict with the truth; `score`
summarises all cases against `criteria`; `protocol` runs these steps in order.
"""
