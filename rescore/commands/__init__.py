"""The commands of ``rescore``, a module for each group of them."""
