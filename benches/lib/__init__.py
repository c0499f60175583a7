"""What benches share: scenes with truth, the measure, tables, pictures, files."""
