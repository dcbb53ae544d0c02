"""Learning over heads: policies, few-shot tuning and repeated training."""
