"""The application: command line, report pages, exports, runs of many photos, the viewer."""
