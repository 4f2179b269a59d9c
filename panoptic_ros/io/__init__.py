"""Read and write files, bags and messages: conversion between bytes and records.

Readers validate all content, and their errors name the file. Writers are atomic: they write a temporary file
and rename it.
"""
