"""Helpers of benches and tests: scenes with truth, the measure, tables, pictures, files."""
