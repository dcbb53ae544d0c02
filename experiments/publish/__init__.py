"""Figures and tables of the documentation, made from kept results."""
