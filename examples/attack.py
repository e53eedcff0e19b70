"""An attack of the lab: a GPS that is led away slowly, a hundred times at each assurance."""

from wonderland_research.attack_lab import ATTACKS, LabSettings, run

if __name__ == "__main__":  # the lab starts processes, which load this file, too
    attack = ATTACKS["gnss-drag"]
    print(attack.title)
    for level in run(LabSettings(attacks=(attack.name,), tries=100, processes=1)).attacks[0].levels:
        print(f"assurance {level.level}: {level.won} of {level.tries} permissions won")
