"""Gates, test results and estimators that several folders of core share."""
