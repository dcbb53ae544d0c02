"""Where the mismatch is: in which recordings, when, at which frequency and drive."""
