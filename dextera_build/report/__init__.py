"""The report: a run's event log and the store become one offline HTML file."""
