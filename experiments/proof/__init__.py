"""A blind proof of the diagnosis: effects concealed, sealed, diagnosed from recordings alone, unsealed, scored.

`corpus` says which cases; `concealment` has an independent plant record them; `sealing` commits to the truth; `blind`
and `watched` run ``inkjet diagnose`` on one campaign; `cluster` says where; `judging` holds a verdict against the
truth; `score` sums up; `run` is the order of all this, and `command` its door.
"""
