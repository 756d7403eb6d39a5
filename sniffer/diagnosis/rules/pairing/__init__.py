"""Who answers whom, who does not, and who answers as well."""
