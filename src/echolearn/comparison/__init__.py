"""Trained runs judged on sets and surveys: tables, tests, figures, a report."""
