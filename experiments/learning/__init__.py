"""Learning over heads: policies, few-shot tuning, repeated training."""
