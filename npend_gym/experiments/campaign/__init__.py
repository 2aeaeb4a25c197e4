"""Campaigns: what a `Plan` says, divided into tasks, on one machine or many, with nothing lost.

A `Campaign` runs the tasks of a plan in worker processes. It keeps their results in a folder, as
parts of tables (Parquet files). What a plan can be stands in `npend_gym.experiments.studies`. See
`docs/campaigns.md` for the files, and `npend campaign` for the command.
"""
