"""The report: one offline HTML file from a run's event log and the store."""
