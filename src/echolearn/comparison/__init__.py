"""Trained runs on test sets and surveys: tables, tests, figures, a report."""
