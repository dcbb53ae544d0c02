"""A blind proof of the diagnosis: effects concealed, sealed, diagnosed from recordings alone, unsealed, scored.

`corpus` says which cases; `concealment` has an independent plant record them; `sealing` commits to the truth;
`blind_run` and `sandbox` run ``inkjet diagnose`` on one campaign; `judge` holds a verdict against the truth; `score`
sums up against `criteria`; `protocol` is the order of all this.
"""
