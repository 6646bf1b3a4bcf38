"""Gates, test results and estimators that several rooms share."""
