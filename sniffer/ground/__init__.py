"""What everything stands on: records, tables, times, the greedy walk; it knows no protocol."""
