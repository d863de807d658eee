"""The shell around ``aeroskein.evaluation``: reads fused, truth and report files, prints tables, writes the report."""
