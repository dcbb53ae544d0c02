"""Where work is done, on processes or a cluster, and on which code and packages its numbers depend."""
