"""Localizers: one module each, one interface (`localization.localizer.Localizer`)."""
