"""Compiling everything ahead."""
