"""Pages of the studies of rescore/studies, under the same names.

The page "evidence" gathers ablation, distractors and sweep.
"""
