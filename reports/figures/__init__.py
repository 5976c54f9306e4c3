"""Plots, as Plotly takes them."""
