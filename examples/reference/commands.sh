mtp-bench run stp --env MTP-Merge-v0 --scenes 1 -o runs/merge    # store what an agent answers
mtp-bench score runs/merge                                       # its errors
mtp-bench worst runs/merge --top 3                               # the worst moments, and whose fault they were
mtp-bench events runs/merge --kind lost                          # every loss of an object
mtp-bench view runs/merge --at lost-0 --png frame.png            # a picture of one
