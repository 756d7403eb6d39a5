"""The process beside a recording that shows it live."""
