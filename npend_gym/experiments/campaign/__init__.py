"""Campaigns: the release experiment swept at scale, on one machine or many, with nothing lost.

A `CampaignPlan` says what to release. A `Campaign` divides it into tasks and runs them in worker
processes. It keeps their results in a folder, as parts of tables (Parquet files) and a journal.
`analyse` reads them. See `docs/campaigns.md` for the files, and `npend campaign` for the command.
"""
