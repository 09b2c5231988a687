"""Classifiers: one module each, one interface (`classifiers.classifier.Classifier`)."""
