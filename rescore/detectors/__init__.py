"""Two sliding-window car detectors: HOG + SVM and boosted image fragments."""
