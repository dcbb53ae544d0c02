"""The virtual instruments: what a strain gauge and a self-sensing circuit would record of a given head."""
