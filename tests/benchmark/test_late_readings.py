"""The study of late readings: who is told one by one leaves no instrument idle."""

from inkjet_env.experiments.benchmark.studies import late_readings


def test_every_optimiser_is_tried_each_way_it_can(monkeypatch, capsys):
    monkeypatch.setattr(late_readings, "ENTRANTS", ("random", "pso", "cma-es"))
    late_readings.main(["--repeats", "2", "--budget", "120", "--slots", "4"])
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if "%" in line]
    assert [(row[0], row[1]) for row in rows] == [
        ("random", "batch"), ("random", "one"), ("pso", "batch"), ("pso", "one"), ("cma-es", "batch"),
    ]  # fmt: skip
    by_batch, one_by_one = (float(row[-3]) for row in rows[2:4])
    assert one_by_one < by_batch
    busy = [float(row[-2]) for row in rows]
    assert min(busy[1], busy[3]) > 90 > busy[4]
