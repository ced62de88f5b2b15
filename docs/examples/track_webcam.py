"""Track with a webcam: draw a box around the object, press Enter; Esc stops."""
import asterism
import cv2

camera = cv2.VideoCapture(0)
ok, image = camera.read()
if not ok:
    raise SystemExit("no image from camera 0")
box = cv2.selectROI("track", image)
if not any(box):
    raise SystemExit("no box was drawn")
tracker = asterism.OpenCvTracker.create("dpt_plus")  # was cv2.TrackerCSRT.create()
tracker.init(image, box)
while ok:
    ok, image = camera.read()
    if not ok:
        break
    found, box = tracker.update(image)
    cv2.rectangle(image, box, (0, 255, 0) if found else (0, 0, 255), 2)
    cv2.imshow("track", image)
    if cv2.waitKey(1) == 27:  # Esc
        break
