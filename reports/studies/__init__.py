"""A page for each study of rescore/studies, under the same name."""
