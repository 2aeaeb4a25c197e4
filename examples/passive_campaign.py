"""Release thousands of chains and see how the period depends on N and on the starting angle.

Run it with `python examples/passive_campaign.py`; the results are written to `campaign/`. It may be
interrupted at any time, even by a power failure: run it again and it continues where it stopped.
"""

import sys

from tqdm import tqdm

from npend_gym.experiments import Campaign, CampaignPlan, analyse
from npend_gym.report import analysis_text, write_analysis

folder = sys.argv[1] if len(sys.argv) > 1 else "campaign"
trials = int(sys.argv[2]) if len(sys.argv) > 2 else 100

# Every combination of N and amplitude is released `trials` times, each time from a slightly
# different angle: the amplitude plus up to one degree, drawn at random.
plan = CampaignPlan(n=[3, 5, 10, 20], amplitude=[0.1, 0.3, 0.5, 0.7, 0.9, 1.1], trials=trials)

if __name__ == "__main__":  # worker processes import this file, but must not start campaigns
    with Campaign(plan, folder) as campaign:
        print(campaign.status.text() or f"{campaign.status.count} tasks were done before")
        bar = tqdm(total=plan.task_count, initial=campaign.status.count, unit="task")
        # On all cores; campaign.run("ray") on a cluster. Other machines may help, without a driver:
        # Campaign(plan, folder, shard="2/8") does the second of eight shares.
        for task, error in campaign.run():
            bar.update()
            if error:
                print(task.id, "failed:", error)
        bar.close()

    # The median over the bobs follows T ~ sqrt(N + 1/2), and grows with the amplitude a as
    # c T1 [1 + b a^2 / (1 + d a^2)], where T1 is the period of the slowest normal mode.
    analysis = analyse(folder)
    print(analysis_text(analysis))
    print(
        "written:", *write_analysis(analysis, campaign.out / "analysis", figures=True), sep="\n  "
    )
